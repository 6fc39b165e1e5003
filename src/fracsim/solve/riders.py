"""Particles without volume are drawn only: they ride on the particles around them, on their side of a crack."""

from dataclasses import replace

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

        count = int((particles.volume > 0).sum())
        base, self.h = particles.X[:count].astype(np.float64), h
        k = min(CARRIERS + 1, count)
        distance, near = cKDTree(base).query(particles.X[count:], k=k)
        distance, near = distance.reshape(-1, k), near.reshape(-1, k)
        self.carriers = near[:, : max(k - 1, 1)]
        ratio = distance[:, : self.carriers.shape[1]] / np.maximum(distance[:, -1:], 1e-12)
        self.weights = np.maximum((1 - ratio**2) ** 2, 1e-6)
        self.offset = particles.X[count:, None] - base[self.carriers]

    def __call__(self, frame: Frame, fragment: Array) -> Frame:
        """The frame of moved and riding particles; `fragment` is that of each moved one, (N,), as of failed ones -1."""
        s, x, F = self.carriers, frame.x.astype(np.float64), frame.F
        near = np.linalg.norm(x[s] - x[s[:, :1]], axis=2) < TOGETHER * self.h
        near &= fragment[s] == fragment[s[:, :1]]
        weight = self.weights * near
        weight /= weight.sum(axis=1, keepdims=True)
        to = x[s] + np.einsum("pkij,pkj->pki", F[s], self.offset)

        def both(values: Array, of_carriers: Array) -> Array:
            """Values of the moved particles, (N, ...), and the mean of those of carriers, (M, K, ...)."""
            mean = np.einsum("pk,pk...->p...", weight, of_carriers)
            return np.concatenate([values, mean.astype(np.float32)])

        v, tau, d = (both(a, a[s]) for a in (frame.v, frame.tau, frame.d))
        return replace(frame, x=both(frame.x, to), v=v, F=both(F, F[s]), tau=tau, d=d)
