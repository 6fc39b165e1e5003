"""Soft light baked into the colour of a surface, because splats are rendered unlit."""

from collections.abc import Callable

import numpy as np

from fracsim.asset.procedural.shapes import Array, norm, smoothstep
from fracsim.asset.procedural.texture import mix

Distance = Callable[[Array], Array]

LIGHT = np.array([-0.4511, 0.7018, 0.5514], np.float32)  # direction to the key light: above, left, in front
HALF = np.array([-0.2555, 0.3975, 0.8813], np.float32)  # half way between the key light and the eye on +z
STEP = 0.006  # of the difference quotient: half a particle spacing, so that bumps finer than a splat do not alias
REACH = 0.05  # distance along the normal over which the neighbourhood shades a surface
FULL, GONE = 0.014, 0.040  # depths down to which the light is full, and from which there is none
WARMTH = np.array([[0.85], [1.0], [1.15]], np.float32)  # powers of the light in each channel: shade is warm
CREASE = np.array([[0.62], [0.72], [0.78]], np.float32)  # part of each channel that a closed crease loses


def dot(direction: Array, n: Array) -> Array:
    """Cosine (N,) between a direction (3,) and normals n (3, N); with so few rows faster than a matrix product."""
    out: Array = direction[0] * n[0] + direction[1] * n[1] + direction[2] * n[2]
    return out


def normal(distance: Distance, P: Array, here: Array) -> Array:
    """Unit outward normals (3, N) at rows (3, N), by forward differences from the distances `here` (N,)."""
    steps = STEP * np.eye(3, dtype=P.dtype)
    g = np.stack([distance(P + step[:, None]) - here for step in steps])
    out: Array = g / np.maximum(norm(g), 1e-9)
    return out


def openness(distance: Distance, P: Array, here: Array, n: Array) -> Array:
    """Part of its surroundings, (N,) in [0, 1], that a surface point at a row (3, N) sees.

    From the distances `here` (N,) and those at REACH along the normals n (3, N).
    """
    lack = 1 - (distance(P + REACH * n) - here) / REACH
    seen: Array = 1 - np.clip(lack, 0.0, 1.0)
    return seen


def bake(distance: Distance, P: Array, depth: Array, colour: Array, gloss: float, sharpness: float = 24.0) -> Array:
    """Colour (3, N) in [0, 1] with light, shade in creases and a highlight of strength `gloss` near the surface.

    `colour` (3, N) is the unlit colour, `depth` (N,) the distance below the surface. `distance` and the rows P (3, N)
    are in view coordinates (eye on +z) of the object before it is squeezed along the line of sight.
    """
    out = np.clip(colour, 0.0, 1.0).astype(np.float32)
    lit = np.flatnonzero(depth < GONE)
    Q = P[:, lit].astype(np.float32, copy=False)
    here = distance(Q)
    n = normal(distance, Q, here)
    seen = openness(distance, Q, here, n)
    key, sky = np.clip(dot(LIGHT, n), 0.0, 1.0), 0.5 + 0.5 * n[1]
    strength = (0.58 + 0.45 * key + 0.18 * sky) ** WARMTH
    shine = gloss * np.clip(dot(HALF, n), 0.0, 1.0) ** sharpness * seen
    light = out[:, lit] * strength * (1 - (1 - seen) * CREASE)
    light = light + (1 - np.clip(light, 0, 1)) * shine
    w = 1 - smoothstep(FULL, GONE, depth[lit].astype(np.float32))
    out[:, lit] = np.clip(mix(out[:, lit], light, w), 0.0, 1.0)
    return out
