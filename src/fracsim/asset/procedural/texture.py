"""Colours of points: bread crumb, rubber, and the mottling shared by all built-in objects."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from fracsim.asset.procedural import noise
from fracsim.asset.procedural.shapes import Array, hypot, smoothstep

Paint = Callable[[Array], Array]


def rgb(red: float, green: float, blue: float) -> NDArray[np.float32]:
    """An sRGB colour as a column [3, 1]."""
    return np.array([[red], [green], [blue]], np.float32)


def mix(a: Array, b: Array, w: Array) -> Array:
    """Colours `a` [3, N] or [3, 1] turned to `b` by weights [N]."""
    out: Array = a + (b - a) * w
    return out


def coat(P: Array, weight: Array, inside: Paint, outside: Paint) -> Array:
    """`inside(P)` turned to `outside(P)` by `weight` [N], each evaluated only where it shows."""
    out = np.zeros((3, P.shape[1]), np.float32)
    for paint, share in ((inside, 1 - weight), (outside, weight)):
        at = np.flatnonzero(share > 0)
        out[:, at] += paint(P[:, at]) * share[at]
    return out


def ramp(x: Array, stops: Sequence[float], colours: Sequence[Array]) -> Array:
    """Colours [3, N] by linear interpolation of `colours` at `stops`."""
    table = np.concatenate(colours, axis=1)
    return np.stack([np.interp(x, stops, channel) for channel in table]).astype(np.float32)


def mottle(P: Array, strength: float, seed: int) -> Array:
    """A factor [N] about 1 that varies at lengths of 1/14, 1/34 and 1/80."""
    spots = noise.value(P, 14, seed) + noise.value(P, 34, seed + 1) + 0.7 * noise.value(P, 80, seed + 2)
    return 1 + strength * spots


def marble(colour: Array, P: Array, strength: float, seed: int) -> Array:
    """Colours [3, N] or [3, 1] mottled by a power of themselves: clouds of deeper and paler tone, never of grey."""
    spots = mottle(P, strength, seed)
    out: Array = np.maximum(colour, 0) ** np.maximum(spots, 0.2)
    return out * (1 + 0.06 * (1 - spots))


def crumb(P: Array, pale: Array, pore: Array, seed: int, size: float = 1.0) -> Array:
    """Baked dough [3, N]: `pale` walls around pores of two sizes, the larger about 0.04 `size` across."""
    large, own = noise.cells(P, 17 / size, seed)
    radius = 0.20 + 0.28 * own
    ragged = large / radius + 0.35 * noise.value(P, 30 / size, seed + 2)
    hole = np.maximum(
        1 - smoothstep(0.5, 1.2, ragged), 0.6 * smoothstep(0.15, 0.6, noise.value(P, 60 / size, seed + 1))
    )
    return marble(mix(pale, pore, hole), P, 0.25, seed + 3)


def rubber(P: Array, body: Array, seed: int) -> Array:
    """Plain body-coloured rubber [3, N] with faint clouds and fine filler grains."""
    near, own = noise.cells(P, 40, seed)
    grain = (1 - smoothstep(0.15, 0.35, near)) * (own - 0.5)
    return marble(body, P, 0.12, seed + 3) * (1 + 0.35 * grain)


def skin(depth: Array, low: float = 0.016, high: float = 0.026) -> Array:
    """Weight [N] of a coat of paint: 1 on the surface, 0 below `high`."""
    return 1 - smoothstep(low, high, depth)


def disc(u: Array, v: Array, radii: tuple[float, float], edge: float = 0.012) -> Array:
    """Weight [N] of a painted ellipse about the origin of surface coordinates (u, v), its edge `edge` wide."""
    reach = hypot(u / radii[0], v / radii[1])
    return 1 - smoothstep(1 - edge / min(radii), 1.0, reach)
