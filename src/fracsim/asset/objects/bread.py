"""Tin loaf seen from its long side, leaning its slashed crown to the viewer; crust outside, porous crumb inside."""

from functools import partial

import numpy as np

from fracsim.asset.procedural import noise, shading, texture
from fracsim.asset.procedural.shapes import Array, box, hypot, in_blocks, smoothstep, tilt, union, unsqueeze, vector

BOUNDS = ((-0.53, -0.48, -0.17), (0.53, 0.45, 0.17))
CLASS = "low_stretch"

LEAN, SQUEEZE = 24.0, 0.43
SLASHES, PITCH = 4, 0.215
PALE, GOLD = texture.rgb(0.96, 0.80, 0.50), texture.rgb(0.91, 0.64, 0.28)
BROWN, DARK = texture.rgb(0.66, 0.36, 0.13), texture.rgb(0.43, 0.21, 0.08)
CRUMB, PORE = texture.rgb(0.98, 0.92, 0.77), texture.rgb(0.86, 0.72, 0.50)


@in_blocks()
def distance(P: Array) -> Array:
    """Signed distance (N,) of points (N, 3), negative inside."""
    return SQUEEZE * _round(unsqueeze(P, SQUEEZE))


@in_blocks(np.float32)
def colour(P: Array, depth: Array) -> Array:
    """sRGB (N, 3) of points (N, 3) at `depth` (N,) below the surface: crust that fades to crumb within 0.03."""
    crumb = partial(texture.crumb, pale=CRUMB, pore=PORE, seed=41)
    body = texture.coat(P, texture.coating(depth, 0.010, 0.030), crumb, _crust)
    return shading.bake(_round, unsqueeze(P, SQUEEZE), depth, body, gloss=0.22, sharpness=10)


def _round(V: Array) -> Array:
    """Distance (N,) of rows (3, N) in unsqueezed view coordinates."""
    Q = tilt(V, LEAN, 1.0)
    lump = 0.007 * noise.value(Q, 6, 42) + 0.003 * noise.value(Q, 16, 43)
    return 0.98 * (_loaf(Q) + 0.022 * _slash(Q) + lump)


def _loaf(Q: Array) -> Array:
    """Distance (N,) of upright rows (3, N) to the tapered tin part and the crown above it."""
    R = Q.copy()
    R[0] = Q[0] / (1 + 0.10 * Q[1])
    tin = box(R, (0, -0.13, 0), (0.455, 0.295, 0.18), 0.05)
    C = Q.copy()
    C[1] = Q[1] + 0.30 * Q[0] ** 2
    crown = box(C, (0, 0.23, 0), (0.50, 0.185, 0.225), 0.16)
    return union(tin, crown, 0.02)


def _slash(Q: Array) -> Array:
    """1 within the cuts across the crown, 0 outside, (N,), of upright rows (3, N)."""
    down = np.arctan2(Q[2], Q[1] - 0.14)
    x = Q[0] - 0.16 * (down - 0.5)
    index = np.clip(np.round(x / PITCH + 0.5) - 0.5, 0.5 - SLASHES / 2, SLASHES / 2 - 0.5)
    lens = 1 - np.square((down - 0.45) / 0.85)
    inside = 0.046 * np.sqrt(np.maximum(lens, 0)) - np.abs(x - PITCH * index)
    shell = smoothstep(0.08, 0.14, hypot(Q[1] - 0.14, Q[2])) * smoothstep(-0.02, 0.04, Q[1])
    return smoothstep(-0.012, 0.022, inside) * shell * smoothstep(0.0, 0.3, lens)


def _crust(P: Array) -> Array:
    """Crust colours (3, N) of rows (3, N): dark crown, golden sides, paler at rim and foot, torn crumb in the cuts,
    flour.
    """
    Q = tilt(P, LEAN, SQUEEZE)
    height, cut = Q[1], _slash(Q)
    blotch = noise.fractal(Q, 7, 44, octaves=4)
    bake = 0.36 + 0.70 * smoothstep(0.08, 0.38, height + 0.3 * Q[0] ** 2) + 0.30 * blotch
    bake = bake - 0.22 * smoothstep(0.09, 0.02, np.abs(height - 0.07)) + 0.25 * smoothstep(-0.30, -0.43, height)
    torn = 0.08 + 0.25 * np.abs(noise.fractal(Q * vector((2.2, 0.8, 0.8), Q), 14, 45)) + 0.35 * (1 - cut)
    bake = bake + (torn - bake) * smoothstep(0.15, 0.75, cut)
    crust = texture.ramp(bake, (0.0, 0.40, 0.80, 1.2), (PALE, GOLD, BROWN, DARK))
    flour = smoothstep(0.15, 0.7, noise.fractal(Q, 18, 46) + 0.5 * blotch) * smoothstep(0.1, 0.3, height) * (1 - cut)
    return texture.marble(texture.mix(crust, texture.rgb(0.97, 0.91, 0.80), 0.45 * flour), Q, 0.20, 47)
