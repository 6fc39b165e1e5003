"""Rubber whale in profile, facing left: blue back, pale grooved belly, raised flukes, a spout."""

from functools import partial

import numpy as np

from fracsim.asset.procedural import noise, shading, texture
from fracsim.asset.procedural.shapes import Array, capsule, ellipsoid, hypot, in_blocks, mirror, smoothstep, union

BOUNDS = ((-0.52, -0.48, -0.34), (0.59, 0.50, 0.34))
CLASS = "high_stretch"

BLUE, DEEP = texture.rgb(0.20, 0.52, 0.82), texture.rgb(0.09, 0.32, 0.62)
PALE, GROOVE = texture.rgb(1.0, 0.99, 0.95), texture.rgb(0.66, 0.78, 0.88)
WATER, BLUSH = texture.rgb(0.55, 0.83, 0.96), texture.rgb(0.95, 0.60, 0.62)
BLACK, WHITE = texture.rgb(0.06, 0.07, 0.12), texture.rgb(1.0, 1.0, 0.98)
RUBBER = texture.rgb(0.28, 0.52, 0.74)
EYE = (-0.265, -0.055)


@in_blocks()
def distance(P: Array) -> Array:
    """Signed distance (N,) of points (N, 3), negative inside."""
    return _solid(P)


@in_blocks(np.float32)
def colour(P: Array, depth: Array) -> Array:
    """sRGB (N, 3) of points (N, 3) at `depth` (N,) below the surface: paint over plain rubber."""
    body = texture.coat(mirror(P, 2), texture.coating(depth), partial(texture.rubber, body=RUBBER, seed=121), _paint)
    return shading.bake(_solid, P, depth, body, gloss=0.55, sharpness=28)


def _solid(P: Array) -> Array:
    """Distance (N,) of rows (3, N)."""
    Q = mirror(P, 2)
    body = union(ellipsoid(Q, (-0.06, -0.12, 0), (0.43, 0.335, 0.27)), _tail(Q), 0.10)
    body = union(body, _flipper(Q), 0.02)
    return union(body, _spout(Q), 0.03)


def _tail(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the tail with two flukes in the picture plane."""
    root = capsule(Q, (0.22, -0.17, 0), (0.41, 0.03, 0), 0.20, 0.11)
    tail = union(root, capsule(Q, (0.41, 0.03, 0), (0.425, 0.24, 0), 0.11, 0.07), 0.08)
    left = capsule(Q, (0.42, 0.24, 0), (0.30, 0.39, 0), 0.08, 0.048)
    right = capsule(Q, (0.42, 0.24, 0), (0.52, 0.38, 0), 0.08, 0.045)
    return union(tail, np.minimum(left, right), 0.04)


def _flipper(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the flipper on the flank, pointing back and down."""
    return capsule(Q, (-0.06, -0.20, 0.25), (0.09, -0.30, 0.26), 0.065, 0.04)


def _spout(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the jet of water that parts in two."""
    jet = capsule(Q, (-0.17, 0.12, 0), (-0.17, 0.34, 0), 0.055, 0.045)
    left = capsule(Q, (-0.17, 0.35, 0), (-0.285, 0.40, 0), 0.05, 0.07)
    right = capsule(Q, (-0.17, 0.35, 0), (-0.055, 0.40, 0), 0.05, 0.07)
    return union(jet, np.minimum(left, right), 0.03)


def _paint(Q: Array) -> Array:
    """Skin colours (3, N) of rows (3, N): blue back with light spots, grooved belly, face and water."""
    x, y = Q[0], Q[1]
    cloud = noise.fractal(Q, 8, 122, octaves=4)
    paint = texture.mix(BLUE, DEEP, np.clip(0.35 + 0.5 * cloud + 0.8 * smoothstep(0.0, 0.25, y), 0, 1))
    near, own = noise.cells(Q, 12, 123)
    paint = texture.mix(paint, WATER, 0.6 * smoothstep(0.25, 0.17, near) * (own > 0.45))
    waterline = y + 0.185 - 0.55 * smoothstep(0.05, 0.5, x) * (x + 0.1) + 0.006 * cloud
    groove = 0.7 * smoothstep(0.45, 0.9, np.sin(2 * np.pi * (waterline / 0.052 + 0.25)))
    paint = texture.mix(paint, texture.mix(PALE, GROOVE, groove), smoothstep(0.004, -0.008, waterline))
    paint = texture.mix(paint, BLUE, smoothstep(0.012, 0.0, _flipper(Q)))
    paint = texture.mix(paint, WATER, smoothstep(0.015, 0.0, _spout(Q)))
    return _face(Q, texture.marble(paint, Q, 0.20, 124))


def _face(Q: Array, paint: Array) -> Array:
    """`paint` (3, N) at rows (3, N) with a smile, a cheek, an eye and its glint."""
    side = smoothstep(0.03, 0.06, Q[2])
    x, y = Q[0], Q[1]
    smile = smoothstep(0.015, 0.007, np.abs(hypot(x + 0.36, y + 0.02) - 0.15)) * (y < -0.10) * (x < -0.24)
    paint = texture.mix(paint, BLACK, smile * side)
    paint = texture.mix(paint, BLUSH, 0.65 * side * texture.disc(x + 0.20, y + 0.13, (0.05, 0.036), 0.03))
    u, v = x - EYE[0], y - EYE[1]
    paint = texture.mix(paint, WHITE, side * texture.disc(u, v, (0.062, 0.072)))
    paint = texture.mix(paint, BLACK, side * texture.disc(u + 0.008, v, (0.046, 0.057)))
    return texture.mix(paint, WHITE, side * texture.disc(u + 0.020, v - 0.023, (0.018, 0.020), 0.007))
