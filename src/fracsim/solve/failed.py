"""Failed particles follow intact ones on their side of the crack (`total`)."""

import numpy as np
from scipy.sparse import csr_array

from fracsim.records import Array

CARRIERS = 8
"""A failed particle follows up to this many intact ones."""
TOGETHER = 3.0
"""Carriers further than this many cells from the nearest one are on the other side of the crack."""


class FollowIntact:
    """Positions and deformation of failed particles from the nearest intact ones of the rest configuration.

    x = mean over carriers s of x_s + F_s (X - X_s), where the carriers are the intact particles nearest at rest that
    are still near the nearest one: one side of the crack only. Velocity and F are means over the same carriers.
    """

    def __init__(self, X: Array, h: float) -> None:
        """X: rest positions [m], (N, 3); h: cell size [m]."""
        self.X, self.h = X - X.mean(axis=0), h
        self.count = -1

    def _choose(self, failed: Array) -> None:
        """Find the carriers when more particles have failed."""
        if int(failed.sum()) == self.count:
            return
        from scipy.spatial import cKDTree

        self.count = int(failed.sum())
        intact = np.flatnonzero(~failed)
        near = cKDTree(self.X[intact]).query(self.X[failed], k=min(CARRIERS, len(intact)))[1]
        used, place = np.unique(near, return_inverse=True)
        self.used, self.carriers = intact[used], place.reshape(self.count, -1)

    def __call__(self, x: Array, v: Array, F: Array, failed: Array, fragment: Array) -> None:
        """Overwrite x (N, 3), v (N, 3) and F (N, 3, 3) where `failed`, (N,), in place; carriers share a fragment."""
        if not failed.any() or failed.all():
            return
        self._choose(failed)
        u, s = self.used, self.carriers
        near = np.linalg.norm(x[u][s] - x[u][s[:, :1]], axis=2) < TOGETHER * self.h
        near &= fragment[u][s] == fragment[u][s[:, :1]]
        weight = (near / near.sum(axis=1, keepdims=True)).astype(F.dtype)
        mean = csr_array((weight.ravel(), s.ravel(), np.arange(0, s.size + 1, s.shape[1])), (len(s), len(u)))
        origin = x[u] - np.einsum("pij,pj->pi", F[u], self.X[u])  # where F takes what is at 0 at rest
        F[failed] = (mean @ F[u].reshape(-1, 9)).reshape(-1, 3, 3)
        x[failed] = mean @ origin + np.einsum("pij,pj->pi", F[failed], self.X[failed])
        v[failed] = mean @ v[u]
