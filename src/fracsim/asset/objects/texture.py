"""What the objects are made of, as colours of points: bread crumb, rubber, and the mottling all of them share."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracsim.asset.objects import noise
from fracsim.asset.objects.shapes import smoothstep

Array = NDArray[np.floating[Any]]


def rgb(red: float, green: float, blue: float) -> NDArray[np.float32]:
    """An sRGB colour [3]."""
    return np.array([red, green, blue], np.float32)


def mix(a: Array, b: Array, w: Array) -> Array:
    """Colours `a` [N, 3] or [3] turned to `b` by weights [N]."""
    out: Array = a + (b - a) * w[:, None]
    return out


def ramp(x: Array, stops: Sequence[float], colours: Sequence[Array]) -> Array:
    """Colours [N, 3] by linear interpolation of `colours` at `stops`."""
    table = np.stack(colours)
    return np.stack([np.interp(x, stops, table[:, c]) for c in range(3)], axis=1).astype(np.float32)


def mottle(P: Array, strength: float, seed: int) -> Array:
    """A factor [N, 1] about 1 that varies at lengths of 1/14, 1/34 and 1/80."""
    spots = noise.value(P, 14, seed) + noise.value(P, 34, seed + 1) + 0.7 * noise.value(P, 80, seed + 2)
    return (1 + strength * spots)[:, None]


def crumb(P: Array, pale: Array, pore: Array, seed: int, size: float = 1.0) -> Array:
    """Baked dough [N, 3]: `pale` walls around pores of two sizes, the larger about 0.04 `size` across."""
    large, own = noise.cells(P, 17 / size, seed)
    small, _ = noise.cells(P, 42 / size, seed + 1)
    radius = 0.20 + 0.28 * own
    ragged = large / radius + 0.35 * noise.value(P, 30 / size, seed + 2)
    hole = np.maximum(1 - smoothstep(0.5, 1.2, ragged), 0.6 * (1 - smoothstep(0.15, 0.45, small)))
    return mix(pale, pore, hole.astype(np.float32)) * mottle(P, 0.04, seed + 3)


def rubber(P: Array, body: Array, seed: int) -> Array:
    """Plain body-coloured rubber [N, 3] with faint clouds and fine filler grains."""
    near, own = noise.cells(P, 40, seed)
    grain = (1 - smoothstep(0.15, 0.35, near)) * (own - 0.5)
    return body * (mottle(P, 0.05, seed + 3) + 0.35 * grain[:, None])


def skin(depth: Array, low: float = 0.016, high: float = 0.026) -> Array:
    """Weight [N] of a coat of paint: 1 on the surface, 0 below `high`."""
    return 1 - smoothstep(low, high, depth)


def disc(u: Array, v: Array, radii: tuple[float, float], edge: float = 0.012) -> Array:
    """Weight [N] of a painted ellipse about the origin of surface coordinates (u, v), its edge `edge` wide."""
    reach = np.hypot(u / radii[0], v / radii[1])
    return 1 - smoothstep(1 - edge / min(radii), 1.0, reach)
