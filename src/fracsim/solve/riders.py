"""Particles without volume are drawn only: they ride on the particles around them, on their side of a crack."""

from dataclasses import replace
from typing import Any

import numpy as np

from fracsim.records import Array, Frame, Particles
from fracsim.solve.failed import TOGETHER

CARRIERS = 8
"""A rider follows up to this many particles."""


def moved(particles: Particles) -> Particles:
    """The particles with volume, which the solver moves; all, if there are no others."""
    solid = particles.volume > 0
    if solid.all():
        return particles
    names = ("X", "volume", "covariance", "opacity", "sh", "surface")
    return replace(particles, **{name: getattr(particles, name)[solid] for name in names})


class Riders:
    """Completes frames of the moved particles, the first ones, by those that ride on them.

    x = sum over carriers s of w_s (x_s + F_s (X - X_s)), where the carriers are those nearest at rest that are still
    near the nearest one, as for failed particles. The weights w fall to 0 at the farthest carrier, so that riders
    beside each other move alike. All else is a mean with the same weights.
    """

    def __init__(self, particles: Particles, h: float) -> None:
        """Riders follow moved particles in `particles`; h [m] is the size of a cell."""
        from scipy.spatial import cKDTree

        count, X = int((particles.volume > 0).sum()), particles.X.astype(np.float64)
        self.base, self.X, self.h = X[:count], X[count:], h
        k = min(CARRIERS + 1, count)
        distance, near = (a.reshape(-1, k) for a in cKDTree(self.base).query(self.X, k=k))
        self.carriers = near[:, : max(k - 1, 1)]
        ratio = distance[:, : self.carriers.shape[1]] / np.maximum(distance[:, -1:], 1e-12)
        self.weights = np.maximum((1 - ratio**2) ** 2, 1e-6)

    def __call__(self, frame: Frame, fragment: Array) -> Frame:
        """The frame of moved and riding particles; `fragment` is that of each moved one, (N,), as of failed ones -1."""
        x, F = frame.x.astype(np.float64), frame.F.astype(np.float64)
        # x_s + F_s (X - X_s) is linear in what belongs to s alone: one product with a sparse matrix is enough.
        origin = x - np.einsum("nij,nj->ni", F, self.base)
        own = (origin, frame.v, F.reshape(-1, 9), frame.tau.reshape(-1, 9), frame.d[:, None])
        mean = self._weights(frame.x, fragment) @ np.concatenate(own, axis=1)
        origin, v, F, tau, d = np.split(mean.astype(np.float64), (3, 6, 15, 24), axis=1)
        F, tau = F.reshape(-1, 3, 3), tau.reshape(-1, 3, 3)
        ridden = {"x": origin + np.einsum("nij,nj->ni", F, self.X), "v": v, "F": F, "tau": tau, "d": d[:, 0]}
        x, v, F, tau, d = (np.concatenate([getattr(frame, n), a.astype(np.float32)]) for n, a in ridden.items())
        return replace(frame, x=x, v=v, F=F, tau=tau, d=d)

    def _weights(self, x: Array, fragment: Array) -> Any:
        """Weights of the moved particles, at x (N, 3), in each rider, a sparse matrix of (riders, N)."""
        from scipy.sparse import csr_array

        s = self.carriers
        apart = x[s] - x[s[:, :1]]
        near = np.einsum("pki,pki->pk", apart, apart) < (TOGETHER * self.h) ** 2
        near &= fragment[s] == fragment[s[:, :1]]
        weight = self.weights * near
        weight /= weight.sum(axis=1, keepdims=True)
        rows = np.arange(0, s.size + 1, s.shape[1])
        return csr_array((weight.ravel(), s.ravel(), rows), shape=(len(s), len(x)))
