"""Rubber duck in profile, facing left: yellow body, orange beak, painted eye, wing and cheek."""

from functools import partial

import numpy as np

from fracsim.asset.procedural import noise, shading, texture
from fracsim.asset.procedural.shapes import (
    Array,
    capsule,
    ellipsoid,
    in_blocks,
    mirror,
    smoothstep,
    sphere,
    union,
    vector,
)

BOUNDS = ((-0.56, -0.46, -0.33), (0.53, 0.51, 0.33))
CLASS = "high_stretch"

YELLOW, AMBER = texture.rgb(1.0, 0.83, 0.12), texture.rgb(0.96, 0.62, 0.06)
ORANGE, BLUSH = texture.rgb(0.97, 0.45, 0.08), texture.rgb(0.99, 0.58, 0.25)
BLACK, WHITE = texture.rgb(0.07, 0.06, 0.08), texture.rgb(1.0, 1.0, 0.98)
RUBBER = texture.rgb(0.93, 0.70, 0.13)
EYE = (-0.245, 0.285)


@in_blocks()
def distance(P: Array) -> Array:
    """Signed distance (N,) of points (N, 3), negative inside."""
    return _solid(P)


@in_blocks(np.float32)
def colour(P: Array, depth: Array) -> Array:
    """sRGB (N, 3) of points (N, 3) at `depth` (N,) below the surface: paint over plain rubber."""
    body = texture.coat(mirror(P, 2), texture.coating(depth), partial(texture.rubber, body=RUBBER, seed=91), _paint)
    return shading.bake(_solid, P, depth, body, gloss=0.60, sharpness=30)


def _solid(P: Array) -> Array:
    """Distance (N,) of rows (3, N)."""
    Q = mirror(P, 2)
    body = union(_trunk(Q), _head(Q), 0.08)
    body = union(body, _wing(Q), 0.02)
    return union(body, _beak(Q), 0.02)


def _trunk(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the body with breast and raised tail."""
    body = union(ellipsoid(Q, (0.04, -0.16, 0), (0.42, 0.27, 0.27)), sphere(Q, (-0.16, -0.14, 0), 0.25), 0.10)
    return union(body, capsule(Q, (0.30, -0.10, 0), (0.44, 0.25, 0), 0.15, 0.055), 0.12)


def _head(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the head."""
    return sphere(Q, (-0.16, 0.235, 0), 0.24)


def _wing(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the wing on the flank, its tip raised to the tail."""
    flat = Q * vector((1, 1, 2.2), Q)
    return 0.62 * capsule(flat, (0.03, -0.12, 0.50), (0.29, -0.01, 0.45), 0.145, 0.070)


def _beak(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the two halves of the beak."""
    upper = ellipsoid(Q, (-0.41, 0.205, 0), (0.12, 0.055, 0.115))
    return np.minimum(upper, ellipsoid(Q, (-0.39, 0.140, 0), (0.09, 0.045, 0.090)))


def _paint(Q: Array) -> Array:
    """Skin colours (3, N) of rows (3, N): yellow, deeper below, with feathers on the wing, cheek, eye and beak."""
    deep = smoothstep(0.15, -0.40, Q[1]) + 0.9 * noise.fractal(Q, 12, 92, octaves=4)
    paint = texture.mix(YELLOW, AMBER, np.clip(0.45 * deep, 0, 1))
    feather = np.abs(np.sin(np.pi * (Q[1] + 0.08 - 0.9 * np.square(Q[0] - 0.06)) / 0.062))
    streak = smoothstep(0.5, 0.1, feather) * smoothstep(0.08, 0.14, Q[0]) * smoothstep(0.012, -0.004, _wing(Q))
    paint = texture.mix(paint, ORANGE, 0.6 * streak)
    paint = texture.mix(paint, BLUSH, 0.7 * texture.disc(Q[0] + 0.20, Q[1] - 0.165, (0.07, 0.055), 0.05))
    beak = texture.mix(ORANGE, BLACK, 0.55 * smoothstep(0.014, 0.004, np.abs(Q[1] - 0.170 - 0.1 * (Q[0] + 0.41))))
    paint = texture.mix(paint, beak, smoothstep(0.010, 0.0, _beak(Q)))
    return _eye(Q, texture.marble(paint, Q, 0.22, 94))


def _eye(Q: Array, paint: Array) -> Array:
    """`paint` (3, N) at rows (3, N) with a black eye, its white rim and glint."""
    u, v = Q[0] - EYE[0], Q[1] - EYE[1]
    on = smoothstep(0.05, 0.08, Q[2])
    paint = texture.mix(paint, WHITE, on * texture.disc(u, v, (0.070, 0.088)))
    paint = texture.mix(paint, BLACK, on * texture.disc(u + 0.008, v, (0.053, 0.071)))
    return texture.mix(paint, WHITE, on * texture.disc(u + 0.022, v - 0.028, (0.021, 0.024), 0.008))
