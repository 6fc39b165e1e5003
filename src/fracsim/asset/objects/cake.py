"""Round layer cake that leans its top to the viewer: pink icing with drips, piped cream, cherries, layers inside."""

import numpy as np

from fracsim.asset.procedural import noise, shading, texture
from fracsim.asset.procedural.shapes import (
    Array,
    cylinder,
    ellipsoid,
    fold_angle,
    hypot,
    in_blocks,
    smoothstep,
    sphere,
    tilt,
    union,
    unsqueeze,
)

BOUNDS = ((-0.54, -0.53, -0.38), (0.54, 0.50, 0.33))
CLASS = "low_stretch"

LEAN, SQUEEZE = 28.0, 0.6
TOP, BOTTOM, RADIUS = 0.17, -0.31, 0.475
SWIRLS, SHELLS = 8, 22
SPONGE, PORE = texture.rgb(0.96, 0.79, 0.46), texture.rgb(0.80, 0.57, 0.27)
CREAM, JAM = texture.rgb(1.0, 0.97, 0.90), texture.rgb(0.80, 0.13, 0.20)
ICING, CHERRY = texture.rgb(0.98, 0.62, 0.70), texture.rgb(0.78, 0.05, 0.11)
SPRINKLES = np.array([[0.30, 0.99, 0.45, 0.62], [0.62, 0.85, 0.76, 0.38], [0.86, 0.30, 0.42, 0.75]], np.float32)


@in_blocks()
def distance(P: Array) -> Array:
    """Signed distance (N,) of points (N, 3), negative inside."""
    return SQUEEZE * _round(unsqueeze(P, SQUEEZE))


@in_blocks(np.float32)
def colour(P: Array, depth: Array) -> Array:
    """sRGB (N, 3) of points (N, 3) at `depth` (N,) below the surface: icing and cream over sponge, cream and jam."""
    Q = tilt(P, LEAN, SQUEEZE)
    body = texture.coat(Q, texture.coating(depth, 0.014, 0.024), _layers, _outside)
    fruit, cream = _cherries(Q), np.minimum(_shells(Q), _swirls(Q))
    topping = texture.mix(CREAM, CHERRY, smoothstep(0.010, 0.0, fruit)) * texture.mottle(Q, 0.04, 81)
    body = texture.mix(body, topping, smoothstep(0.010, 0.0, np.minimum(fruit, cream)))
    return shading.bake(_round, unsqueeze(P, SQUEEZE), depth, body, gloss=0.45)


def _round(V: Array) -> Array:
    """Distance (N,) of rows (3, N) in unsqueezed view coordinates."""
    Q = tilt(V, LEAN, 1.0)
    body = cylinder(Q, (0, (TOP + BOTTOM) / 2, 0), RADIUS - 0.014, (TOP - BOTTOM) / 2, 0.05)
    body = body - 0.016 * _iced(Q) - 0.005 * np.cos((Q[1] - TOP) * 2 * np.pi / 0.16)
    body = union(union(body, _shells(Q), 0.015), _swirls(Q), 0.015)
    return 0.95 * union(body, _cherries(Q), 0.008)


def _places(Q: Array) -> Array:
    """Rows (3, N) relative to the axis of the nearest rosette: one of the ring, or the central one."""
    R = fold_angle(Q, SWIRLS)
    R[2] -= 0.34 * (R[2] > 0.17)
    return R


def _swirls(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the piped rosettes of two fluted tiers."""
    R = _places(Q)
    flute = 0.004 * np.cos(8 * np.arctan2(R[0], R[2]))
    foot = ellipsoid(R, (0, TOP + 0.018, 0), (0.105, 0.045, 0.105))
    out: Array = union(foot, ellipsoid(R, (0, TOP + 0.065, 0), (0.078, 0.04, 0.078)), 0.01) + flute
    return out


def _cherries(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the cherries, one on each rosette."""
    return sphere(_places(Q), (0, TOP + 0.105, 0), 0.068)


def _shells(Q: Array) -> Array:
    """Distance (N,) of rows (3, N) to the piped shells round the foot."""
    R = fold_angle(Q, SHELLS)
    return ellipsoid(R, (0, BOTTOM + 0.045, RADIUS - 0.02), (0.075, 0.06, 0.06))


def _drip(Q: Array) -> Array:
    """Height (N,) of rows (3, N) above the lower edge of the icing, in drips of uneven length round the side."""
    angle = np.arctan2(Q[0], Q[2])
    wave = 0.055 * np.cos(13 * angle + 1.1 * np.sin(3 * angle)) * (0.75 + 0.35 * np.cos(5 * angle + 1))
    length = 0.075 + wave * smoothstep(0.2, 0.4, hypot(Q[0], Q[2]))
    out: Array = Q[1] - (TOP - 0.06) + length
    return out


def _iced(Q: Array) -> Array:
    """1 under icing, 0 on the bare side, (N,), of rows (3, N)."""
    return smoothstep(-0.012, 0.016, _drip(Q))


def _outside(Q: Array) -> Array:
    """Surface colours (3, N) of rows (3, N): darker sponge on the bare side, pink icing, sprinkles on the top."""
    near, own = noise.cells(Q, 13, 82)
    top = smoothstep(TOP - 0.03, TOP, Q[1])
    sprinkle = smoothstep(0.34, 0.24, near) * top
    icing = texture.marble(ICING, Q, 0.20, 83)
    icing = texture.mix(icing, SPRINKLES[:, (own * 997).astype(np.int64) % 4], sprinkle)
    return texture.mix(_layers(Q) * texture.rgb(0.97, 0.92, 0.86), icing, smoothstep(0.3, 0.7, _iced(Q)))


def _layers(Q: Array) -> Array:
    """Inner colours (3, N) of rows (3, N): three sponges, between them cream with a line of jam."""
    height = Q[1] + 0.006 * noise.value(Q, 9, 84)
    off = np.abs((TOP - height) / 0.16 - np.round(np.clip((TOP - height) / 0.16, 1, 2))) * 0.16
    sponge = texture.crumb(Q, SPONGE, PORE, 85, size=0.75)
    filling = texture.mix(CREAM, JAM, smoothstep(0.010, 0.006, off)) * texture.mottle(Q, 0.05, 86)
    return texture.mix(sponge, filling, smoothstep(0.026, 0.020, off))
