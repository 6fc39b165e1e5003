"""A photo to work on: a loaf on a light table, drawn with noise so that it is no plain shape."""

from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from fracsim.records import Array

CENTRE, RADII = (0.5, 0.53), (0.3, 0.27)
"""Of the loaf, in widths and heights of the picture."""


def loaf(width: int = 640, height: int = 480) -> Array:
    """The picture, (height, width, 3) uint8."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:height, :width]
    u, v = (x / width - CENTRE[0]) / RADII[0], (y / height - CENTRE[1]) / RADII[1]
    inside = _soft(1 - (np.abs(u) ** 2.6 + np.abs(v) ** 2.6), width)
    grain = gaussian_filter(rng.normal(size=(height, width)), width / 160)
    grain /= grain.std()
    light = 0.62 + 0.38 * np.clip(1 - 0.55 * (u + 0.35) ** 2 - 0.5 * (v + 0.5) ** 2, 0, 1) + 0.035 * grain
    for cut in (-0.5, 0.0, 0.5):  # the slashes of the crust
        light += 0.16 * np.exp(-(((u - cut - 0.3 * v) / 0.07) ** 2)) * _soft(0.62 - np.abs(v), 25)
    crust = np.array([205, 140, 74]) * light[..., None]
    table = np.array([226, 222, 214]) + 2.5 * rng.normal(size=(height, width, 1)) - 12 * (y / height)[..., None]
    shade = _soft(1 - ((u / 1.12) ** 2 + ((v - 0.28) / 1.02) ** 2), 8)
    table = table * (1 - 0.28 * shade[..., None])
    colour = inside[..., None] * crust + (1 - inside[..., None]) * table
    return np.clip(colour, 0, 255).astype(np.uint8)


def _soft(level: Array, sharpness: float) -> Array:
    """From 0 where `level`, (H, W), is negative to 1 where it is positive."""
    return 1 / (1 + np.exp(-np.clip(level * sharpness, -50, 50)))


def photo(path: Path, width: int = 640, height: int = 480) -> Path:
    """The picture as a file."""
    Image.fromarray(loaf(width, height)).save(path)
    return path
