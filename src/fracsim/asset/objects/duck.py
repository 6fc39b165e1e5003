"""Rubber duck in profile, facing left: yellow body, orange beak, painted eye, wing and cheek."""

import numpy as np

from fracsim.asset.objects import noise, shading, texture
from fracsim.asset.objects.shapes import Array, capsule, ellipsoid, in_blocks, mirror, smoothstep, sphere, union

BOUNDS = ((-0.60, -0.47, -0.31), (0.54, 0.52, 0.31))
CLASS = "high_stretch"

YELLOW, AMBER = texture.rgb(1.0, 0.83, 0.12), texture.rgb(0.96, 0.62, 0.06)
ORANGE, BLUSH = texture.rgb(0.97, 0.45, 0.08), texture.rgb(0.99, 0.58, 0.25)
BLACK, WHITE = texture.rgb(0.07, 0.06, 0.08), texture.rgb(1.0, 1.0, 0.98)
RUBBER = texture.rgb(0.93, 0.70, 0.13)
EYE = (-0.285, 0.285)


@in_blocks
def distance(P: Array) -> Array:
    """Signed distance [N] of points [N, 3], negative inside."""
    Q = mirror(P, 2)
    body = union(_trunk(Q), _head(Q), 0.08)
    body = union(body, ellipsoid(Q, (0.13, -0.10, 0.235), (0.21, 0.13, 0.06)), 0.025)
    return union(body, _beak(Q), 0.02)


@in_blocks
def colour(P: Array, depth: Array) -> Array:
    """sRGB [N, 3] of points [N, 3] at `depth` [N] below the surface: paint over plain rubber."""
    body = texture.mix(texture.rubber(P, RUBBER, 91), _paint(mirror(P, 2)), texture.skin(depth))
    return shading.bake(distance, P, depth, body, gloss=0.60, sharpness=30)


def _trunk(Q: Array) -> Array:
    """Body with breast and a raised tail."""
    body = union(ellipsoid(Q, (0.04, -0.16, 0), (0.42, 0.27, 0.27)), sphere(Q, (-0.16, -0.14, 0), 0.25), 0.10)
    return union(body, capsule(Q, (0.30, -0.10, 0), (0.46, 0.12, 0), 0.13, 0.05), 0.12)


def _head(Q: Array) -> Array:
    """Head, with a tuft at the back."""
    return sphere(Q, (-0.20, 0.24, 0), 0.235)


def _beak(Q: Array) -> Array:
    """Upper and lower half of the beak."""
    upper = ellipsoid(Q, (-0.45, 0.205, 0), (0.115, 0.050, 0.115))
    return np.minimum(upper, ellipsoid(Q, (-0.43, 0.145, 0), (0.085, 0.042, 0.090)))


def _paint(Q: Array) -> Array:
    """Yellow that deepens downwards, feather lines on the wing, cheek, eye and beak."""
    deep = smoothstep(0.15, -0.40, Q[:, 1]) + 0.35 * noise.fractal(Q, 9, 92, octaves=4)
    paint = texture.mix(YELLOW, AMBER, np.clip(0.45 * deep, 0, 1))
    wing = ellipsoid(Q, (0.13, -0.10, 0.235), (0.21, 0.13, 0.06))
    feather = np.abs(np.sin(26 * np.hypot(Q[:, 0] + 0.16, Q[:, 1] - 0.02) + 1.5 * noise.value(Q, 9, 93)))
    paint = texture.mix(paint, AMBER, 0.75 * smoothstep(0.35, 0.08, feather) * smoothstep(0.012, -0.004, wing))
    paint = texture.mix(paint, BLUSH, 0.7 * texture.disc(Q[:, 0] + 0.24, Q[:, 1] - 0.175, (0.07, 0.055), 0.05))
    paint = paint * texture.mottle(Q, 0.04, 94)
    beak = texture.mix(ORANGE, BLACK, 0.55 * smoothstep(0.014, 0.004, np.abs(Q[:, 1] - 0.170 - 0.1 * (Q[:, 0] + 0.45))))
    paint = texture.mix(paint, beak * texture.mottle(Q, 0.06, 95), smoothstep(0.010, 0.0, _beak(Q)))
    return _eye(Q, paint)


def _eye(Q: Array, paint: Array) -> Array:
    """A black eye with a white rim and glint."""
    u, v = Q[:, 0] - EYE[0], Q[:, 1] - EYE[1]
    on = smoothstep(0.05, 0.08, Q[:, 2])
    paint = texture.mix(paint, WHITE, on * texture.disc(u, v, (0.062, 0.078)))
    paint = texture.mix(paint, BLACK, on * texture.disc(u + 0.008, v, (0.046, 0.062)))
    return texture.mix(paint, WHITE, on * texture.disc(u + 0.018, v - 0.024, (0.018, 0.020), 0.008))
