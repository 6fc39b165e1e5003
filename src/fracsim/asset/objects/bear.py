"""Rubber teddy bear that sits and faces the viewer: cream muzzle, belly and soles, red bow tie."""

from functools import partial

import numpy as np

from fracsim.asset.procedural import noise, shading, texture
from fracsim.asset.procedural.shapes import (
    Array,
    capsule,
    ellipsoid,
    hypot,
    in_blocks,
    mirror,
    smoothstep,
    sphere,
    union,
)

BOUNDS = ((-0.52, -0.56, -0.25), (0.52, 0.56, 0.30))
CLASS = "high_stretch"

BROWN, DEEP = texture.rgb(0.76, 0.49, 0.25), texture.rgb(0.58, 0.34, 0.15)
CREAM, PINK = texture.rgb(0.98, 0.87, 0.68), texture.rgb(0.95, 0.66, 0.58)
BLACK, WHITE = texture.rgb(0.10, 0.06, 0.05), texture.rgb(1.0, 1.0, 0.98)
RED, RUBBER = texture.rgb(0.86, 0.13, 0.15), texture.rgb(0.66, 0.41, 0.20)


@in_blocks()
def distance(P: Array) -> Array:
    """Signed distance (N,) of points (N, 3), negative inside."""
    return _solid(P)


@in_blocks(np.float32)
def colour(P: Array, depth: Array) -> Array:
    """sRGB (N, 3) of points (N, 3) at `depth` (N,) below the surface: paint over plain rubber."""
    body = texture.coat(P, texture.coating(depth), partial(texture.rubber, body=RUBBER, seed=101), _paint)
    return shading.bake(_solid, P, depth, body, gloss=0.40, sharpness=20)


def _solid(P: Array) -> Array:
    """Distance (N,) of rows (3, N)."""
    Q = mirror(P, 0)
    body = union(_head(Q), ellipsoid(Q, (0, -0.17, 0), (0.27, 0.28, 0.21)), 0.04)
    body = union(body, _limbs(Q), 0.025)
    return union(body, _bow(Q), 0.012)


def _head(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the head with ears and muzzle."""
    head = union(ellipsoid(Q, (0, 0.24, 0), (0.28, 0.245, 0.22)), sphere(Q, (0.215, 0.425, 0), 0.105), 0.03)
    return union(head, ellipsoid(Q, (0, 0.165, 0.17), (0.125, 0.095, 0.10)), 0.02)


def _limbs(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the hanging arms and the legs, stretched to the viewer."""
    arm = capsule(Q, (0.22, -0.02, 0.04), (0.405, -0.13, 0.08), 0.090, 0.092)
    leg = capsule(Q, (0.16, -0.36, 0.02), (0.30, -0.385, 0.12), 0.125, 0.150)
    return np.minimum(arm, leg)


def _bow(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the bow tie under the chin."""
    knot = sphere(Q, (0, 0.005, 0.205), 0.045)
    return union(knot, ellipsoid(Q, (0.095, 0.005, 0.195), (0.085, 0.065, 0.045)), 0.015)


def _paint(P: Array) -> Array:
    """Skin colours (3, N) of rows (3, N): brown coat with darker clouds, cream, pink and black patches, the bow."""
    Q = mirror(P, 0)
    cloud = 0.5 + 0.6 * noise.fractal(P, 8, 102, octaves=4) + 0.5 * smoothstep(-0.1, -0.5, P[1])
    paint = texture.mix(BROWN, DEEP, np.clip(0.55 * cloud, 0, 1))
    for tone, weight in _patches(Q):
        paint = texture.mix(paint, tone, weight)
    paint = _face(Q, paint)
    paint = texture.mix(paint, texture.mix(RED, WHITE, _dots(Q)), smoothstep(0.012, 0.002, _bow(Q)))
    return texture.marble(paint, P, 0.15, 103)


def _patches(Q: Array) -> list[tuple[Array, Array]]:
    """Colours (3, 1) and weights (N,) of belly, soles, ears and muzzle at rows (3, N)."""
    front = smoothstep(0.02, 0.06, Q[2])
    x, y = Q[0], Q[1]
    muzzle = smoothstep(0.018, 0.0, ellipsoid(Q, (0, 0.165, 0.17), (0.125, 0.095, 0.10))) * front
    return [
        (CREAM, front * texture.disc(x, y + 0.17, (0.175, 0.16), 0.02)),
        (CREAM, smoothstep(0.14, 0.16, Q[2]) * texture.disc(x - 0.31, y + 0.385, (0.098, 0.098), 0.015)),
        (PINK, front * texture.disc(x - 0.225, y - 0.435, (0.062, 0.062), 0.015)),
        (CREAM, muzzle),
    ]


def _face(Q: Array, paint: Array) -> Array:
    """`paint` (3, N) at rows (3, N) with eyes, glint, blush, nose and mouth."""
    front = smoothstep(0.05, 0.08, Q[2])
    x, y = Q[0], Q[1]
    mouth = np.abs(hypot(x - 0.038, y - 0.150) - 0.038)
    line = smoothstep(0.013, 0.005, mouth) * (y < 0.150) + smoothstep(0.012, 0.005, x) * (y > 0.13) * (y < 0.21)
    paint = texture.mix(paint, PINK, 0.6 * front * texture.disc(x - 0.175, y - 0.185, (0.055, 0.042), 0.035))
    paint = texture.mix(paint, BLACK, np.clip(line, 0, 1) * smoothstep(0.2, 0.22, Q[2]))
    paint = texture.mix(paint, BLACK, front * texture.disc(x, y - 0.215, (0.052, 0.036)))
    paint = texture.mix(paint, BLACK, front * texture.disc(x - 0.105, y - 0.285, (0.042, 0.052)))
    return texture.mix(paint, WHITE, front * texture.disc(x - 0.092, y - 0.303, (0.017, 0.019), 0.007))


def _dots(Q: Array) -> Array:
    """1 on the bow's white dots, 0 elsewhere, (N,), of rows (3, N)."""
    near, _ = noise.cells(Q, 18, 108)
    return smoothstep(0.30, 0.22, near)
