"""Where a stretched object ends at a grip, by an elastic bar along the grips' axis in one dimension.

A bar whose nodes are held up to the one at 0 strains as if it ended 0.15 cells before that node, since the particles
there are stretched, too. If the face lies beyond the last held node, the next node (the edge) is tied to the two behind
it, u_1 = a u_2 + b u_3, with a and b such that the rest of the bar strains uniformly.

With u_i = i - f for i > 1, where f is the face, and forces K u, all nodes from the fourth on are in balance. The tie's
force r, -a r, -b r must balance the other three, which gives a and b, and its work r (u_1 - a u_2 - b u_3) must vanish,
which is a quadratic equation for u_1.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from fracsim.records import Array

PLANES, HELD = 20, 8
"""Planes of free nodes, and of held nodes behind each end; three planes inside, an end has no effect any more."""
FINE = 8
"""Particles a cell. Two particles a cell move the ends by at most 0.006 cells."""
STEPS = 25
"""Faces between which weights are interpolated."""


class End(NamedTuple):
    """The end of an object at a grip; lengths in cells.

    Nodes lie in planes across the direction of the grid that is nearest to the axis.
    """

    pitch: float
    """Distance of the planes along the axis."""
    soft: float
    """Distance from a grip's face within which a plane is held."""
    gap: Array
    """Distances of the edge beyond `soft`, 0 to `pitch`, (STEPS,)."""
    table: Array
    """Weights a and b for these gaps, (STEPS, 2)."""

    def weights(self, gap: Array) -> Array:
        """Weights a and b for edges with these gaps, (n,) -> (n, 2)."""
        return np.stack([np.interp(gap, self.gap, column) for column in self.table.T], axis=1)


@cache
def end(along: float) -> End:
    """The end of a bar whose axis has the component `along`, 0.7 to 1, on the nearest direction of the grid."""
    x = along * np.arange(-HELD, PLANES + 2 + HELD)
    K = _stiffness(along, x)
    soft = (_length(K) - along * (PLANES + 1)) / 2
    gap = np.linspace(0, along, STEPS)
    weights = [_weights(K, np.maximum(x - (along - soft - g), 0)) for g in gap]
    known = [k for k, w in enumerate(weights) if w is not None]
    return End(along, float(soft), gap[known], np.array([weights[k] for k in known]))


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
    """Length of the uniform bar that is as stiff as this one between its held ends."""
    pulled = (np.arange(len(K)) > HELD + PLANES).astype(float)
    free = slice(HELD + 1, HELD + 1 + PLANES)
    u = pulled.copy()
    u[free] = -np.linalg.solve(K[free, free], K[free] @ pulled)
    return float(1 / (u @ K @ u))


def _weights(K: Array, u: Array) -> Array | None:
    """a and b for a bar whose nodes from the third on are displaced by u; None if nothing balances."""
    first, others = HELD + 1, slice(HELD + 2, HELD + 4)
    u = np.where(np.arange(len(u)) <= first, 0, u)
    force, k = K @ u, K[:, first]
    roots = np.roots([k[first], force[first] + k[others] @ u[others], force[others] @ u[others]])
    if np.iscomplex(roots).any():
        return None
    force = force + roots.min() * k
    return np.asarray(-force[others] / force[first])
