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
BESIDE = np.linspace(0, 3, 25)
"""Distances from a face [cells]; further away, no material is stretched more than the middle."""


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
    strain: Array
    """Strains of particles over that of the middle, for these gaps and at BESIDE, (STEPS, len(BESIDE))."""

    def weights(self, gap: Array) -> Array:
        """Weights a and b for edges with these gaps, (n,) -> (n, 2)."""
        return np.stack([np.interp(gap, self.gap, column) for column in self.table.T], axis=1)

    def excess(self, distance: Array, face: float) -> Array:
        """By how much material at these distances [cells] from a face strains more than the middle, relative, (n,).

        `face`: where the face is [cells beyond the nearest plane of nodes before it]. Where planes lie across the axis,
        the gap follows from that; oblique planes have all gaps at once, of which the worst counts.
        """
        across = self.pitch == 1
        gap = (face - self.soft) % 1
        strain = [np.interp(gap, self.gap, column) if across else column.max() for column in self.strain.T]
        return np.asarray(np.interp(distance, BESIDE, np.maximum(np.array(strain) - 1, 0), left=0, right=0))


@cache
def end(along: float) -> End:
    """The end of a bar whose axis has the component `along`, 0.7 to 1, on the nearest direction of the grid."""
    x = along * np.arange(-HELD, PLANES + 2 + HELD)
    p, B = _gradient(along, x)
    K = B.T @ B / FINE
    soft = (_length(K) - along * (PLANES + 1)) / 2
    gap = np.linspace(0, along, STEPS)
    ends = [(f, _tied(K, np.maximum(x - f, 0))) for f in along - soft - gap]
    known = [k for k, (_, tied) in enumerate(ends) if tied is not None]
    table = np.array([tied[1] for _, tied in ends if tied is not None])
    strain = np.array([np.interp(BESIDE, p - f, B @ tied[0]) for f, tied in ends if tied is not None])
    return End(along, float(soft), gap[known], table, strain)


def _bspline(x: Array) -> Array:
    """Quadratic B-spline of support -1.5 .. 1.5."""
    x = np.abs(x)
    return np.where(x < 0.5, 0.75 - x * x, np.maximum(1.5 - x, 0) ** 2 / 2)


def _gradient(along: float, x: Array) -> tuple[Array, Array]:
    """Positions (P,) of the particles of a bar and how they see planes of nodes at x (M,), (P, M): by the MLS gradient
    4 w (x_i - x_p), the weights averaged across the axis."""
    across = np.sqrt(max(1 - along**2, 0))
    p = (np.arange(round(FINE * (along * (PLANES + 1) + 6))) + 0.5) / FINE - 3
    d, t = (x - p[:, None])[..., None], np.linspace(-2.5, 2.5, 100)
    w = (_bspline(along * d - across * t) * _bspline(across * d + along * t)).sum(axis=-1)
    w /= w.sum(axis=1, keepdims=True)
    B = w * (d[..., 0] - (w * d[..., 0]).sum(axis=1, keepdims=True))
    B /= (B * x).sum(axis=1, keepdims=True)
    return p, np.asarray(B)


def _length(K: Array) -> float:
    """Length of the uniform bar that is as stiff as this one between its held ends."""
    pulled = (np.arange(len(K)) > HELD + PLANES).astype(float)
    free = slice(HELD + 1, HELD + 1 + PLANES)
    u = pulled.copy()
    u[free] = -np.linalg.solve(K[free, free], K[free] @ pulled)
    return float(1 / (u @ K @ u))


def _tied(K: Array, u: Array) -> tuple[Array, Array] | None:
    """Displacements of all nodes, and a and b, for a bar whose nodes from the third on are displaced by u; None if
    nothing balances."""
    first, others = HELD + 1, slice(HELD + 2, HELD + 4)
    u = np.where(np.arange(len(u)) <= first, 0, u)
    force, k = K @ u, K[:, first]
    roots = np.roots([k[first], force[first] + k[others] @ u[others], force[others] @ u[others]])
    if np.iscomplex(roots).any():
        return None
    u[first] = roots.min()
    force = force + u[first] * k
    return u, np.asarray(-force[others] / force[first])
