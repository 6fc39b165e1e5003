"""Bonds between particles that are neighbours at rest: which pieces they hold together, and whether they are torn."""

from functools import cached_property

import numpy as np

from fracsim.records import Array

NEIGHBOUR = 1.5
"""Bonds join particles at most this many spacings apart at rest."""
APART, BEYOND = 1.5, 1.5
"""A bond of intact particles is torn when it is longer than APART cells and BEYOND times what F says."""


class Bonds:
    """Bonds of particles at rest at X [m], (N, 3).

    A bond ends when one of its particles has failed, or when the particles are further apart than the mean F of both
    explains: then the background grid no longer couples them, which is numerical tearing, not damage.
    """

    def __init__(self, X: Array, spacing: float, h: float) -> None:
        self.X, self.reach, self.h = X, NEIGHBOUR * spacing, h

    @cached_property
    def pairs(self) -> Array:
        """Particles that each bond joins, (B, 2) int."""
        from scipy.spatial import cKDTree

        return np.asarray(cKDTree(self.X).query_pairs(self.reach, output_type="ndarray"))

    def intact(self, failed: Array) -> Array:
        """Bonds of particles that have not failed, (B', 2); `failed` is (N,) bool."""
        pairs = self.pairs
        return np.asarray(pairs[~(failed[pairs[:, 0]] | failed[pairs[:, 1]])])

    def pieces(self, bonds: Array) -> Array:
        """A number for each piece that bonds, (B, 2), hold together, (N,) int."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        n = len(self.X)
        graph = coo_matrix((np.ones(len(bonds), np.int8), (bonds[:, 0], bonds[:, 1])), shape=(n, n))
        return np.asarray(connected_components(graph, directed=False)[1])

    def fragments(self, failed: Array) -> Array:
        """Fragments 0, 1, ... of intact particles, largest first, and -1 for failed particles, (N,) int."""
        piece = self.pieces(self.intact(failed))
        size = np.bincount(piece[~failed], minlength=piece.max() + 1)
        rank = np.empty(len(size), np.int64)
        rank[np.argsort(-size, kind="stable")] = np.arange(len(size))
        return np.where(failed, -1, rank[piece])

    def torn(self, bonds: Array, x: Array, F: Array) -> Array:
        """Which bonds are torn with particles at x [m], (N, 3), and gradients F, (N, 3, 3); (B,) bool."""
        a, b = bonds[:, 0], bonds[:, 1]
        length = np.linalg.norm(x[a] - x[b], axis=1)
        suspect = length > APART * self.h
        torn = np.zeros(len(bonds), bool)
        if suspect.any():
            a, b = a[suspect], b[suspect]
            expected = np.einsum("pij,pj->pi", (F[a] + F[b]) / 2, self.X[a] - self.X[b])
            torn[suspect] = length[suspect] > BEYOND * np.linalg.norm(expected, axis=1)
        return torn
