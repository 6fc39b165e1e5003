"""Muffin from the side, leaning its domed top to the viewer: pleated paper cup, cracked crust, chocolate chips."""

import functools

import numpy as np

from fracsim.asset.procedural import noise, shading, texture
from fracsim.asset.procedural.shapes import (
    Array,
    box2,
    ellipsoid,
    hypot,
    in_blocks,
    norm,
    smoothstep,
    tilt,
    union,
    unsqueeze,
    vector,
)

BOUNDS = ((-0.53, -0.55, -0.30), (0.53, 0.47, 0.34))
CLASS = "low_stretch"

LEAN, SQUEEZE = 20.0, 0.6
PLEATS = 26
PALE, GOLD = texture.rgb(0.97, 0.82, 0.50), texture.rgb(0.89, 0.63, 0.29)
BROWN, DARK = texture.rgb(0.70, 0.41, 0.16), texture.rgb(0.47, 0.24, 0.09)
CRUMB, PORE = texture.rgb(0.98, 0.87, 0.58), texture.rgb(0.84, 0.66, 0.35)
CHOCOLATE, GLEAM = texture.rgb(0.25, 0.12, 0.07), texture.rgb(0.52, 0.32, 0.22)
PAPER, STRIPE = texture.rgb(0.98, 0.95, 0.90), texture.rgb(0.35, 0.68, 0.72)
_turn = 2.399963 * np.arange(26)  # the golden angle: chips over the dome without rows
_rise = 0.96 - 0.86 * (np.arange(26) + 0.5) / 26
CHIPS = np.stack([np.sin(_turn) * np.sqrt(1 - _rise**2), _rise, np.cos(_turn) * np.sqrt(1 - _rise**2)], axis=1)


@in_blocks()
def distance(P: Array) -> Array:
    """Signed distance (N,) of points (N, 3), negative inside."""
    return SQUEEZE * _round(unsqueeze(P, SQUEEZE))


@in_blocks(np.float32)
def colour(P: Array, depth: Array) -> Array:
    """sRGB (N, 3) of points (N, 3) at `depth` (N,) below the surface: paper or crust over a crumb with chips."""
    body = texture.coat(P, texture.coating(depth, 0.010, 0.026), _inside, _outside)
    return shading.bake(_round, unsqueeze(P, SQUEEZE), depth, body, gloss=0.20, sharpness=12)


def _round(V: Array) -> Array:
    """Distance (N,) of rows (3, N) in unsqueezed view coordinates."""
    Q = tilt(V, LEAN, 1.0)
    return 0.92 * union(_cup(Q), _dome(Q) - 0.020 * _chip(Q), 0.02)


def _cup(Q: Array) -> Array:
    """Distance (N,) of upright rows (3, N) to the cup, a pleated frustum that widens upwards."""
    radius, height = hypot(Q[0], Q[2]), Q[1]
    pleat = 0.011 * np.cos(PLEATS * np.arctan2(Q[0], Q[2])) * smoothstep(0.15, 0.30, radius)
    return 0.95 * box2(radius - 0.16 * (height + 0.22) - pleat, height + 0.20, (0.345, 0.25), 0.03)


def _dome(Q: Array) -> Array:
    """Distance (N,) of upright rows (3, N) to the lumpy, cracked top above the rim."""
    swell = 0.020 * noise.value(Q, 5.5, 61)
    out: Array = ellipsoid(Q, (0, 0.11, 0), (0.49, 0.31, 0.49)) + swell + 0.018 * _crack(Q)
    return out


def _crack(Q: Array) -> Array:
    """1 along the clefts of the top, 0 elsewhere, (N,), of rows (3, N): the zero lines of a noise."""
    return smoothstep(0.35, 0.0, np.abs(noise.value(Q, 6.5, 63)))


def _chip(Q: Array) -> Array:
    """1 on the chocolate chips of the top, 0 elsewhere, (N,), of rows (3, N), by direction from the dome's middle."""
    d = (Q - vector((0, 0.08, 0), Q)) / vector((0.495, 0.34, 0.495), Q)
    nearest = functools.reduce(np.maximum, (c[0] * d[0] + c[1] * d[1] + c[2] * d[2] for c in CHIPS.tolist()))
    nearest = nearest / np.maximum(norm(d), 1e-3)
    return smoothstep(0.988, 0.997, nearest) * smoothstep(0.02, 0.06, Q[1]) * smoothstep(0.4, 0.8, norm(d))


def _outside(P: Array) -> Array:
    """Surface colours (3, N) of rows (3, N): paper up to its rim, crust above."""
    Q = tilt(P, LEAN, SQUEEZE)
    return texture.coat(Q, smoothstep(0.010, 0.035, Q[1]), _paper, _crust)


def _paper(Q: Array) -> Array:
    """Colours (3, N) of the striped cup at upright rows (3, N), shaded in the pleats, a little stained by fat."""
    pleat = np.cos(PLEATS * np.arctan2(Q[0], Q[2]))
    paper = texture.mix(STRIPE, PAPER, smoothstep(-0.3, 0.3, pleat))
    shade = 0.84 + 0.16 * smoothstep(-1, 0.6, pleat) + 0.08 * noise.fractal(Q, 12, 65)
    return paper * shade * texture.mottle(Q, 0.03, 66)


def _crust(Q: Array) -> Array:
    """Colours (3, N) of the browned top at upright rows (3, N): pale clefts, chocolate chips."""
    blotch, crack = noise.fractal(Q, 8, 67, octaves=4), _crack(Q)
    bake = 0.45 + 0.40 * smoothstep(0.10, 0.38, Q[1]) + 0.30 * blotch - 0.28 * crack
    crust = texture.marble(texture.ramp(bake, (0.0, 0.40, 0.85, 1.2), (PALE, GOLD, BROWN, DARK)), Q, 0.20, 68)
    return texture.mix(crust, CHOCOLATE * texture.mottle(Q, 0.12, 69), smoothstep(0.05, 0.2, _chip(Q)))


def _inside(P: Array) -> Array:
    """Inner colours (3, N) of rows (3, N): yellow crumb with chips."""
    near, own = noise.cells(P, 8.5, 71)
    chip = smoothstep(0.34, 0.28, near) * (own > 0.55)
    return texture.mix(texture.crumb(P, CRUMB, PORE, 72, size=0.9), CHOCOLATE * texture.mottle(P, 0.12, 73), chip)
