"""Rubber swim ring that faces the viewer: red and cream bands, moulded seams and scattered dots."""

from functools import partial

import numpy as np

from fracsim.asset.procedural import noise, shading, texture
from fracsim.asset.procedural.shapes import Array, hypot, in_blocks, smoothstep, torus

BOUNDS = ((-0.52, -0.52, -0.16), (0.52, 0.52, 0.16))
CLASS = "high_stretch"

MAJOR, MINOR = 0.365, 0.135
BANDS = 4
RED, CREAM, NAVY = texture.rgb(0.90, 0.20, 0.17), texture.rgb(1.0, 0.95, 0.84), texture.rgb(0.13, 0.22, 0.46)
RUBBER = texture.rgb(0.80, 0.30, 0.24)


@in_blocks()
def distance(P: Array) -> Array:
    """Signed distance (N,) of points (N, 3), negative inside."""
    return _solid(P)


@in_blocks(np.float32)
def colour(P: Array, depth: Array) -> Array:
    """sRGB (N, 3) of points (N, 3) at `depth` (N,) below the surface: paint over plain rubber."""
    body = texture.coat(P, texture.coating(depth), partial(texture.rubber, body=RUBBER, seed=1), _paint)
    return shading.bake(_solid, P, depth, body, gloss=0.55)


def _solid(P: Array) -> Array:
    """Distance (N,) of rows (3, N)."""
    return torus(P, (0, 0, 0), 2, MAJOR, MINOR) + _seam(P)


def _seam(P: Array) -> Array:
    """Displacement (N,) of the surface at rows (3, N) by the raised moulding lines along the ring."""
    around = np.arctan2(P[2], hypot(P[0], P[1]) - MAJOR)
    out: Array = -0.004 * np.exp(-np.square((np.abs(around) - np.pi / 2) / 0.09))
    return out


def _paint(P: Array) -> Array:
    """Skin colours (3, N) of rows (3, N): bands with navy edges, dots in the other colour, slightly worn."""
    angle = np.arctan2(P[1], P[0]) + 0.03 * noise.value(P, 12, 2)
    wave = np.cos(BANDS * (angle - np.pi / 8))
    paint = texture.mix(RED, CREAM, smoothstep(-0.03, 0.03, wave))
    paint = texture.mix(paint, NAVY, 1 - smoothstep(0.09, 0.14, np.abs(wave)))
    near, own = noise.cells(P, 11, 3)
    dot = (1 - smoothstep(0.24, 0.31, near)) * (own > 0.4) * smoothstep(0.3, 0.5, np.abs(wave))
    paint = texture.mix(paint, np.where(wave > 0, NAVY, CREAM), dot)
    return texture.marble(paint, P, 0.35, 4)
