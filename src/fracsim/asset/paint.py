"""Colours: those of a textured surface, the soft light baked into them, and those of the inside."""

import numpy as np
from scipy.ndimage import map_coordinates

from fracsim.asset.limits import colour
from fracsim.asset.surface import Surface, linear, srgb
from fracsim.records import Array

LIGHT = np.array([-0.45, 0.70, 0.55]) / np.linalg.norm([-0.45, 0.70, 0.55])
"""Direction to the key light, in the world: above, left, in front, as on the built-in objects."""
AMBIENT, KEY = 0.75, 0.25
"""Brightness without the key light, and the part added by it."""
SHALLOW, DEEP = 1.0, 2.0
"""The colour is that of the surface above the first depth, that of the inside below the second [particle spacings]."""
GRAIN = (24.0, 50.0)
"""Cells of the inner grain along the object's largest extent: structure of about 0.04 and 0.02 of it."""


def sample(surface: Surface, face: Array, bary: Array) -> Array:
    """Colours (N, 3), sRGB, at barycentric coordinates `bary` (N, 3) of triangles `face` (N,).

    Texture and corner colours are multiplied in linear light.
    """
    rgb = np.einsum("nc,ncj->nj", bary, surface.rgb[face])
    uv = np.einsum("nc,ncj->nj", bary, surface.uv[face])
    for k in np.unique(surface.texture[face]):
        if k >= 0:
            mine = surface.texture[face] == k
            texel, tint = _bilinear(surface.images[k], uv[mine]), rgb[mine]
            rgb[mine] = np.where(tint == 1, texel, srgb(linear(tint) * linear(texel)))
    out: Array = np.clip(rgb, 0.0, 1.0)
    return out


def _bilinear(image: Array, uv: Array) -> Array:
    """Colours (N, 3) in [0, 1] of `image` (H, W, 3) uint8 at texture coordinates (N, 2), interpolated bilinearly.

    The origin is below left; the image repeats outside [0, 1].
    """
    height, width = image.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - i)[:, None], (y - j)[:, None]
    texel = [[image[(j + b) % height, (i + a) % width] / 255.0 for a in (0, 1)] for b in (0, 1)]
    top, below = (row[0] * (1 - fx) + row[1] * fx for row in texel)
    out: Array = top * (1 - fy) + below * fy
    return out


def lit(rgb: Array, normal: Array) -> Array:
    """Colours `rgb` (N, 3) under a soft key light, (N, 3), with outward unit normals (N, 3)."""
    light = AMBIENT + KEY * (0.5 + 0.5 * normal @ LIGHT)
    out: Array = np.clip(rgb * light[:, None], 0.0, 1.0)
    return out


def inside(text: str, surface_rgb: Array, P: Array, seed: int) -> Array:
    """Colours (N, 3) of the inside at P (N, 3), in extents of the object: the colour `text`, with a grain.

    Without `text` the colour is the mean of the surface's colours `surface_rgb` (M, 3), muted and a little lighter.
    The grain makes the motion of the material visible.
    """
    base = np.array(colour(text)) if text else _muted(surface_rgb.mean(axis=0))
    rng = np.random.default_rng(seed)
    grain = np.sum([0.06 * _noise(P, frequency, rng) for frequency in GRAIN], axis=0)
    out: Array = np.clip(base * (1 + grain[:, None]), 0.0, 1.0)
    return out


def _noise(P: Array, frequency: float, rng: np.random.Generator) -> Array:
    """Smooth noise in [-1, 1], (N,), at P (N, 3), with `frequency` lattice cells a unit."""
    table = rng.uniform(-1.0, 1.0, (32, 32, 32))
    values: Array = map_coordinates(table, P.T * frequency, order=1, mode="grid-wrap")
    return values


def _muted(rgb: Array) -> Array:
    """The colour `rgb` (3,) with less chroma, nearer to white, (3,)."""
    grey = 0.65 * rgb + 0.35 * rgb.mean()
    out: Array = grey + 0.2 * (1 - grey)
    return out


def blend(surface_rgb: Array, inside_rgb: Array, depth: Array) -> Array:
    """Colours (N, 3) at depths (N,) [particle spacings] between those of the surface and of the inside, (N, 3) each."""
    t = np.clip((depth - SHALLOW) / (DEEP - SHALLOW), 0.0, 1.0)
    out: Array = surface_rgb + (inside_rgb - surface_rgb) * (t * t * (3 - 2 * t))[:, None]
    return out
