"""Bread roll: a round bun that leans its top to the viewer, cut crosswise and dusted with flour."""

from functools import partial

import numpy as np

from fracsim.asset.procedural import noise, shading, texture
from fracsim.asset.procedural.shapes import Array, ellipsoid, hypot, in_blocks, smoothstep, tilt, union, unsqueeze

BOUNDS = ((-0.53, -0.51, -0.26), (0.53, 0.47, 0.23))
CLASS = "low_stretch"

LEAN, SQUEEZE = 56.0, 0.55
PALE, GOLD = texture.rgb(0.97, 0.84, 0.58), texture.rgb(0.90, 0.63, 0.29)
BROWN, DARK = texture.rgb(0.72, 0.40, 0.14), texture.rgb(0.50, 0.25, 0.09)
CRUMB, PORE = texture.rgb(0.99, 0.94, 0.82), texture.rgb(0.88, 0.76, 0.56)
FLOUR = texture.rgb(0.99, 0.96, 0.90)


@in_blocks()
def distance(P: Array) -> Array:
    """Signed distance (N,) of points (N, 3), negative inside."""
    return SQUEEZE * _round(unsqueeze(P, SQUEEZE))


@in_blocks(np.float32)
def colour(P: Array, depth: Array) -> Array:
    """sRGB (N, 3) of points (N, 3) at `depth` (N,) below the surface: thin crust over a fine white crumb."""
    crumb = partial(texture.crumb, pale=CRUMB, pore=PORE, seed=51, size=0.8)
    body = texture.coat(P, texture.coating(depth, 0.010, 0.030), crumb, _crust)
    return shading.bake(_round, unsqueeze(P, SQUEEZE), depth, body, gloss=0.30, sharpness=12)


def _round(V: Array) -> Array:
    """Distance (N,) of rows (3, N) in unsqueezed view coordinates."""
    Q = tilt(V, LEAN, 1.0)
    dome = ellipsoid(Q, (0, -0.02, 0), (0.5, 0.32, 0.5))
    foot = ellipsoid(Q, (0, -0.12, 0), (0.48, 0.17, 0.48))
    lump = 0.010 * noise.value(Q, 5, 52) + 0.003 * noise.value(Q, 15, 53)
    return 0.88 * (union(dome, foot, 0.05) + 0.045 * _cross(Q) + lump)


def _cross(Q: Array) -> Array:
    """Depth (N,) of the two cuts at upright rows (3, N): 1 along their middle at the top, 0 outside."""
    a, b = (Q[0] + Q[2]) * np.sqrt(0.5), (Q[0] - Q[2]) * np.sqrt(0.5)
    groove = np.zeros_like(Q[0])
    for along, across in ((a, b), (b, a)):
        inside = 0.075 * (1 - np.square(along / 0.40)) - np.abs(across)
        groove = np.maximum(groove, smoothstep(0.0, 0.065, inside))
    out: Array = groove * smoothstep(0.0, 0.12, Q[1])
    return out


def _crust(P: Array) -> Array:
    """Crust colours (3, N) of rows (3, N): golden flanks, browner shoulders, pale torn cuts, flour on the top."""
    Q = tilt(P, LEAN, SQUEEZE)
    cut, radius = _cross(Q), hypot(Q[0], Q[2])
    blotch = noise.fractal(Q, 7, 54, octaves=4)
    bake = 0.50 + 0.35 * smoothstep(0.0, 0.25, Q[1]) + 0.22 * blotch - 0.25 * smoothstep(-0.02, -0.2, Q[1])
    torn = 0.05 + 0.35 * np.abs(noise.fractal(Q, 20, 55))
    bake = bake + 0.30 * smoothstep(0.02, 0.12, cut) * (1 - smoothstep(0.15, 0.35, cut))
    bake = bake + (torn - bake) * smoothstep(0.2, 0.5, cut)
    crust = texture.ramp(bake, (0.0, 0.42, 0.85, 1.2), (PALE, GOLD, BROWN, DARK))
    dust = noise.fractal(Q, 16, 56) + 0.8 * blotch + 0.25
    flour = smoothstep(0.0, 0.9, dust) * smoothstep(0.05, 0.25, Q[1]) * (1 - smoothstep(0.15, 0.4, cut))
    flour = flour * smoothstep(0.48, 0.30, radius)
    return texture.marble(texture.mix(crust, FLOUR, 0.75 * flour), Q, 0.20, 57)
