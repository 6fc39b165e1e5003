"""Whether the object still holds together, and if not, whether damage or the grid has parted it."""

import numpy as np

from fracsim.records import Array

NEIGHBOUR = 1.5
"""Bonds join particles at most this many spacings apart at rest."""
APART, BEYOND = 1.5, 1.5
"""A bond of intact particles is torn when it is longer than APART cells and BEYOND times what F says."""


class Cohesion:
    """Bonds between neighbours at rest; the object is broken when none of them leads from grip to grip.

    A bond ends when one of its particles has failed, or when the particles are further apart than the mean F of both
    explains: then the background grid no longer couples them, which is numerical tearing, not damage.
    """

    def __init__(self, X: Array, spacing: float, h: float, side: Array) -> None:
        self.X, self.reach, self.h, self.side = X, NEIGHBOUR * spacing, h, side
        self.bonds: Array | None = None

    def _pairs(self) -> Array:
        """Bonds at rest, (B, 2), found when first needed."""
        if self.bonds is None:
            from scipy.spatial import cKDTree

            self.bonds = cKDTree(self.X).query_pairs(self.reach, output_type="ndarray")
        return self.bonds

    def _holds(self, bonds: Array) -> bool:
        """Whether bonds lead from the lower to the upper grip."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        n = len(self.X)
        graph = coo_matrix((np.ones(len(bonds), np.int8), (bonds[:, 0], bonds[:, 1])), shape=(n, n))
        label = connected_components(graph, directed=False)[1]
        return bool(np.isin(label[self.side < 0], label[self.side > 0]).any())

    def fragments(self, failed: Array) -> Array:
        """Labels 0, 1, ... of the pieces that bonds of intact particles hold together, largest first, -1 for failed
        particles, (N,)."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        bonds, n = self._pairs(), len(self.X)
        alive = bonds[~(failed[bonds[:, 0]] | failed[bonds[:, 1]])]
        graph = coo_matrix((np.ones(len(alive), np.int8), (alive[:, 0], alive[:, 1])), shape=(n, n))
        label = connected_components(graph, directed=False)[1]
        size = np.bincount(label[~failed], minlength=label.max() + 1)
        rank = np.empty(len(size), np.int64)
        rank[np.argsort(-size, kind="stable")] = np.arange(len(size))
        return np.where(failed, -1, rank[label])

    def joins(self, label: Array) -> bool:
        """Whether one fragment reaches from grip to grip."""
        low, high = label[self.side < 0], label[self.side > 0]
        return bool(np.isin(low[low >= 0], high[high >= 0]).any())

    def judge(self, x: Array, F: Array, failed: Array) -> str:
        """`whole`, `broken` (by damage) or `torn` (numerically: intact bonds parted)."""
        bonds = self._pairs()
        alive = bonds[~(failed[bonds[:, 0]] | failed[bonds[:, 1]])]
        a, b = alive[:, 0], alive[:, 1]
        length = np.linalg.norm(x[a] - x[b], axis=1)
        suspect = length > APART * self.h
        torn = np.zeros(len(alive), bool)
        if suspect.any():
            a, b = a[suspect], b[suspect]
            due = np.einsum("pij,pj->pi", (F[a] + F[b]) / 2, self.X[a] - self.X[b])
            torn[suspect] = length[suspect] > BEYOND * np.linalg.norm(due, axis=1)
        if not failed.any() and not torn.any():
            return "whole"
        if self._holds(alive[~torn]):
            return "whole"
        return "torn" if self._holds(alive) else "broken"
