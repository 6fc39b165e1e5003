"""Rubber star toy, flat and five-pointed, puffed up in the middle, with a painted face."""

from functools import partial

import numpy as np

from fracsim.asset.procedural import noise, shading, texture
from fracsim.asset.procedural.shapes import Array, ellipsoid, extrude, hypot, in_blocks, mirror, smoothstep, union

BOUNDS = ((-0.54, -0.47, -0.17), (0.54, 0.57, 0.17))
CLASS = "high_stretch"

POINT, NOTCH, ROUNDING = 0.46, 0.215, 0.07  # radii of the sharp star's points and notches, and of its rounding
GOLD, ORANGE, RED = texture.rgb(1.0, 0.80, 0.18), texture.rgb(0.98, 0.55, 0.12), texture.rgb(0.92, 0.33, 0.14)
BLACK, WHITE = texture.rgb(0.12, 0.07, 0.06), texture.rgb(1.0, 1.0, 0.97)
ROSE, RUBBER = texture.rgb(0.96, 0.42, 0.36), texture.rgb(0.93, 0.56, 0.16)


@in_blocks()
def distance(P: Array) -> Array:
    """Signed distance (N,) of points (N, 3), negative inside."""
    return _solid(P)


@in_blocks(np.float32)
def colour(P: Array, depth: Array) -> Array:
    """sRGB (N, 3) of points (N, 3) at `depth` (N,) below the surface: paint over plain rubber."""
    body = texture.coat(P, texture.coating(depth), partial(texture.rubber, body=RUBBER, seed=111), _paint)
    return shading.bake(_solid, P, depth, body, gloss=0.50, sharpness=26)


def _solid(P: Array) -> Array:
    """Distance (N,) of rows (3, N)."""
    plate = extrude(_star(P), P[2], 0.095, 0.09)
    return union(plate, ellipsoid(P, (0, 0, 0), (0.30, 0.30, 0.145)), 0.05)


def _star(P: Array) -> Array:
    """Distance (N,) of rows (3, N), in the plane, to a star with rounded points, one of them up."""
    sector = 2 * np.pi / 5
    angle = np.arctan2(P[0], P[1])
    angle, radius = np.abs(angle - sector * np.round(angle / sector)), hypot(P[0], P[1])
    u, v = radius * np.sin(angle), radius * np.cos(angle)
    ex, ey = NOTCH * np.sin(sector / 2), NOTCH * np.cos(sector / 2) - POINT
    t = np.clip((u * ex + (v - POINT) * ey) / (ex * ex + ey * ey), 0, 1)
    side = np.sign(u * ey - (v - POINT) * ex)
    out: Array = -side * hypot(u - t * ex, v - POINT - t * ey) - ROUNDING
    return out


def _paint(P: Array) -> Array:
    """Skin colours (3, N) of rows (3, N): gold in the middle, red at the rim, speckled like a starfish, with a face."""
    edge = -_star(P) / 0.24 + 0.24 * noise.fractal(P, 11, 112, octaves=4)
    paint = texture.ramp(edge, (0.05, 0.30, 0.75), (RED, ORANGE, GOLD))
    near, own = noise.cells(P, 13, 113)
    paint = texture.mix(paint, np.where((own > 0.6), GOLD, RED), 0.55 * smoothstep(0.30, 0.20, near) * (own > 0.3))
    return _face(mirror(P, 0), texture.marble(paint, P, 0.18, 114))


def _face(Q: Array, paint: Array) -> Array:
    """`paint` (3, N) at rows (3, N) with eyes, glint, rosy cheeks and a smile."""
    front = smoothstep(0.02, 0.05, Q[2])
    x, y = Q[0], Q[1]
    smile = smoothstep(0.017, 0.008, np.abs(hypot(x, y - 0.02) - 0.085)) * smoothstep(-0.02, -0.035, y)
    paint = texture.mix(paint, ROSE, 0.75 * front * texture.disc(x - 0.155, y + 0.035, (0.052, 0.040), 0.03))
    paint = texture.mix(paint, BLACK, front * smile)
    paint = texture.mix(paint, BLACK, front * texture.disc(x - 0.095, y - 0.055, (0.042, 0.058)))
    return texture.mix(paint, WHITE, front * texture.disc(x - 0.082, y - 0.078, (0.018, 0.021), 0.007))
