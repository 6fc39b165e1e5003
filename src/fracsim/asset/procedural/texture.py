"""Colours (3, N) of points, rows (3, N): bread crumb, rubber, and the mottling shared by all built-in objects."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from fracsim.asset.procedural import noise
from fracsim.asset.procedural.shapes import Array, hypot, smoothstep

Paint = Callable[[Array], Array]


def rgb(red: float, green: float, blue: float) -> NDArray[np.float32]:
    """An sRGB colour as a column (3, 1)."""
    return np.array([[red], [green], [blue]], np.float32)


def mix(a: Array, b: Array, w: Array) -> Array:
    """Colours (3, N): a + w (b - a), with a and b (3, N) or (3, 1), and weights w (N,)."""
    out: Array = a + (b - a) * w
    return out


def coat(P: Array, weight: Array, inside: Paint, outside: Paint) -> Array:
    """Colours (3, N) at rows (3, N): (1 - weight) inside(P) + weight outside(P), `weight` (N,) in [0, 1].

    Each paint is evaluated only where its weight is positive.
    """
    out = np.zeros((3, P.shape[1]), np.float32)
    for paint, share in ((inside, 1 - weight), (outside, weight)):
        at = np.flatnonzero(share > 0)
        out[:, at] += paint(P[:, at]) * share[at]
    return out


def ramp(x: Array, stops: Sequence[float], colours: Sequence[Array]) -> Array:
    """Colours (3, N) at x (N,), interpolated linearly between `colours`, (3, 1) each, given at `stops`."""
    table = np.concatenate(colours, axis=1)
    return np.stack([np.interp(x, stops, channel) for channel in table]).astype(np.float32)


def mottle(P: Array, strength: float, seed: int) -> Array:
    """A factor (N,) about 1 at rows (3, N) that varies at lengths of 1/14, 1/34 and 1/80."""
    spots = noise.value(P, 14, seed) + noise.value(P, 34, seed + 1) + 0.7 * noise.value(P, 80, seed + 2)
    return 1 + strength * spots


def marble(colour: Array, P: Array, strength: float, seed: int) -> Array:
    """Colours (3, N): `colour` (3, N) or (3, 1), mottled at rows (3, N).

    Each colour is raised to a power that varies: clouds become deeper or paler in tone, not grey.
    """
    spots = mottle(P, strength, seed)
    out: Array = np.maximum(colour, 0) ** np.maximum(spots, 0.2)
    return out * (1 + 0.06 * (1 - spots))


def crumb(P: Array, pale: Array, pore: Array, seed: int, size: float = 1.0) -> Array:
    """Colours (3, N) of baked dough at rows (3, N): walls `pale`, (3, 1), around pores `pore`, (3, 1), of two sizes.

    The larger pores are about 0.04 `size` across.
    """
    large, own = noise.cells(P, 17 / size, seed)
    radius = 0.20 + 0.28 * own
    ragged = large / radius + 0.35 * noise.value(P, 30 / size, seed + 2)
    hole = np.maximum(
        1 - smoothstep(0.5, 1.2, ragged), 0.6 * smoothstep(0.15, 0.6, noise.value(P, 60 / size, seed + 1))
    )
    return marble(mix(pale, pore, hole), P, 0.25, seed + 3)


def rubber(P: Array, body: Array, seed: int) -> Array:
    """Colours (3, N) at rows (3, N) of rubber of colour `body` (3, 1), with faint clouds and fine filler grains."""
    near, own = noise.cells(P, 40, seed)
    grain = (1 - smoothstep(0.15, 0.35, near)) * (own - 0.5)
    return marble(body, P, 0.12, seed + 3) * (1 + 0.35 * grain)


def coating(depth: Array, low: float = 0.016, high: float = 0.026) -> Array:
    """Weight (N,) of a coat of paint at depths (N,): 1 down to `low`, 0 below `high`."""
    return 1 - smoothstep(low, high, depth)


def disc(u: Array, v: Array, radii: tuple[float, float], edge: float = 0.012) -> Array:
    """Weight (N,) of a painted ellipse about the origin of surface coordinates u and v, (N,) each; its edge is `edge`
    wide.
    """
    reach = hypot(u / radii[0], v / radii[1])
    return 1 - smoothstep(1 - edge / min(radii), 1.0, reach)
