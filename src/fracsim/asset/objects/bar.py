"""Plain test bar, 0.6 x 0.2 x 0.2, with painted grid lines that show the stretch."""

from functools import partial

import numpy as np

from fracsim.asset.procedural import shading, texture
from fracsim.asset.procedural.shapes import Array, box, in_blocks, smoothstep, vector

BOUNDS = ((-0.32, -0.12, -0.12), (0.32, 0.12, 0.12))
CLASS = "high_stretch"

HALF = (0.3, 0.1, 0.1)
PITCH, LINE = 0.05, 0.006  # pitch of the painted grid, and half width of its lines: two particles across
LIGHT, DARK = texture.rgb(0.95, 0.80, 0.55), texture.rgb(0.90, 0.62, 0.38)
INK, RUBBER = texture.rgb(0.12, 0.20, 0.42), texture.rgb(0.84, 0.50, 0.32)


@in_blocks()
def distance(P: Array) -> Array:
    """Signed distance (N,) of points (N, 3), negative inside."""
    return _solid(P)


@in_blocks(np.float32)
def colour(P: Array, depth: Array) -> Array:
    """sRGB (N, 3) of points (N, 3) at `depth` (N,) below the surface: a chequered, lined skin over rubber."""
    body = texture.coat(P, texture.coating(depth, 0.008, 0.014), partial(texture.rubber, body=RUBBER, seed=1), _grid)
    return shading.bake(_solid, P, depth, body, gloss=0.25)


def _solid(P: Array) -> Array:
    """Distance (N,) of rows (3, N)."""
    return box(P, (0, 0, 0), HALF, 0.012)


def _grid(P: Array) -> Array:
    """Skin colours (3, N) of rows (3, N): two tones by square, ink on the lines; a face shows only the lines in it."""
    chequer = np.floor(P / PITCH).sum(axis=0) % 2
    off = np.abs((P / PITCH - np.round(P / PITCH)) * PITCH)
    off = np.where(np.abs(P) > vector(HALF, P) - 1.5 * LINE, 1.0, off)
    line = 1 - smoothstep(LINE - 0.002, LINE, off.min(axis=0))
    tones = texture.mix(LIGHT, DARK, chequer.astype(np.float32))
    return texture.marble(texture.mix(tones, INK, line), P * 1.6, 0.30, 9)
