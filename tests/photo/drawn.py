"""Photos that are drawn, so that the object in them is known."""

from pathlib import Path

import numpy as np
from PIL import Image

from fracsim.records import Array

WIDTH, HEIGHT = 240, 180
LOAF = (110.0, 95.0, 66.0, 44.0)
"""Centre x and y, half width and half height of the ellipse [px]."""


def ellipse(width: int = WIDTH, height: int = HEIGHT, at: tuple[float, float, float, float] = LOAF) -> Array:
    """Whether pixel centres lie in an ellipse, (height, width) bool."""
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    inside: Array = ((x - at[0]) / at[2]) ** 2 + ((y - at[1]) / at[3]) ** 2 < 1
    return inside


def ground(width: int = WIDTH, height: int = HEIGHT) -> Array:
    """A table in the light of a window: two linear ramps, (height, width, 3) in [0, 1]."""
    x, y = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    return np.stack([0.62 + 0.2 * x, 0.66 + 0.1 * y, 0.75 - 0.1 * x], axis=-1)


def crust(width: int = WIDTH, height: int = HEIGHT) -> Array:
    """Brown with waves of several lengths, (height, width, 3) in [0, 1]."""
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    wave = sum(
        np.sin(2 * np.pi * (x * np.cos(a) + y * np.sin(a)) / n) * n / 60 for a, n in ((0.3, 9), (1.2, 14), (2.5, 31))
    )
    return np.clip(np.array([0.62, 0.38, 0.16]) + 0.12 * wave[..., None], 0, 1)


def picture(mask: Array) -> Array:
    """A photo of an object, (height, width) bool, (height, width, 3) uint8."""
    height, width = mask.shape
    colours = np.where(mask[..., None], crust(width, height), ground(width, height))
    return np.rint(255 * colours).astype(np.uint8)


def save(path: Path, mask: Array | None = None) -> Path:
    """Write a photo of the loaf, or of another object."""
    Image.fromarray(picture(ellipse() if mask is None else mask)).save(path)
    return path


def overlap(one: Array, other: Array) -> float:
    """Intersection over union of two masks."""
    return float((one & other).sum() / (one | other).sum())
