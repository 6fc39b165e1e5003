"""Where a stretched object ends that hangs on held nodes: an elastic bar along the grips' axis, in one dimension.

A bar whose nodes are held up to the one at 0 strains as if it ended 0.15 cells before that node, since particles there
are stretched, too. For a face farther out, at f, the next node but for its place would have to be bound by a condition
u_1 = a u_2 + b u_3 that leaves the rest of the bar in uniform strain. With u_i = i - f for i > 1 and forces K u, all
nodes from the fourth on are in balance. The condition's force r, -a r, -b r must balance the other three, which gives a
and b, and its work r (u_1 - a u_2 - b u_3) must vanish, which is a quadratic equation for u_1.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from fracsim.records import Array

PLANES, HELD = 20, 8
"""Planes of nodes that are free, and that are held behind each end; what happens there is forgotten after three."""
FINE = 8
"""Particles a cell; with two, the ends lie elsewhere by 0.006 cells at most."""
STEPS = 25
"""Faces between which shares are interpolated."""


class End(NamedTuple):
    """The end of an object, whose nodes lie in planes across the axis, `pitch` apart along the direction of the grid
    that is nearest to the axis; all lengths in cells."""

    pitch: float
    soft: float
    """From the face of a grip to the first plane that need not be held for it."""
    gap: Array
    """How much farther from the face the first free plane, the edge, may be: 0 to `pitch`, .."""
    share: Array
    """.. and the shares that the edge must then get of the velocities of the two planes behind it, relative to the
    grip, (STEPS, 2)."""

    def shares(self, gap: Array) -> Array:
        """Both shares for edges with these gaps, (n, 2)."""
        return np.stack([np.interp(gap, self.gap, share) for share in self.share.T], axis=1)


@cache
def end(along: float) -> End:
    """The end of a bar whose axis has this component, 0.7 to 1, along the nearest direction of the grid."""
    x = along * np.arange(-HELD, PLANES + 2 + HELD)
    K = _stiffness(along, x)
    soft = (_length(K) - along * (PLANES + 1)) / 2
    gap = np.linspace(0, along, STEPS)
    share = [_shares(K, np.maximum(x - (along - soft - g), 0)) for g in gap]
    known = [k for k, s in enumerate(share) if s is not None]
    return End(along, float(soft), gap[known], np.array([share[k] for k in known]))


def _bspline(x: Array) -> Array:
    """Quadratic B-spline of support -1.5 .. 1.5."""
    x = np.abs(x)
    return np.where(x < 0.5, 0.75 - x * x, np.maximum(1.5 - x, 0) ** 2 / 2)


def _stiffness(along: float, x: Array) -> Array:
    """Stiffness between planes of nodes at x of a bar of unit modulus and section, whose particles see them by the MLS
    gradient 4 w (x_i - x_p), the weights averaged across the axis."""
    across = np.sqrt(max(1 - along**2, 0))
    p = (np.arange(round(FINE * (along * (PLANES + 1) + 6))) + 0.5) / FINE - 3
    d, t = (x - p[:, None])[..., None], np.linspace(-2.5, 2.5, 100)
    w = (_bspline(along * d - across * t) * _bspline(across * d + along * t)).sum(axis=-1)
    w /= w.sum(axis=1, keepdims=True)
    B = w * (d[..., 0] - (w * d[..., 0]).sum(axis=1, keepdims=True))
    B /= (B * x).sum(axis=1, keepdims=True)
    return np.asarray(B.T @ B / FINE)


def _length(K: Array) -> float:
    """Length of the uniform bar as stiff as this one between its held ends."""
    moved = (np.arange(len(K)) > HELD + PLANES).astype(float)
    free = slice(HELD + 1, HELD + 1 + PLANES)
    u = moved.copy()
    u[free] = -np.linalg.solve(K[free, free], K[free] @ moved)
    return float(1 / (u @ K @ u))


def _shares(K: Array, u: Array) -> Array | None:
    """a and b for a bar whose nodes from the third on are displaced by u; None if nothing balances."""
    first, others = HELD + 1, slice(HELD + 2, HELD + 4)
    u = np.where(np.arange(len(u)) <= first, 0, u)
    force, k = K @ u, K[:, first]
    roots = np.roots([k[first], force[first] + k[others] @ u[others], force[others] @ u[others]])
    if np.iscomplex(roots).any():
        return None
    force = force + roots.min() * k
    return np.asarray(-force[others] / force[first])
