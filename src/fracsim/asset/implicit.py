"""Solids given by a distance function: their bounding box, and the steps down to their surface."""

from collections.abc import Callable

import numpy as np

from fracsim.asset.fill import points, slabs
from fracsim.records import Array

Field = Callable[[Array], Array]
CORNERS = np.array([[1, -1, -1], [-1, -1, 1], [-1, 1, -1], [1, 1, 1]], np.float32)


class Implicit:
    """A solid in the world given by an approximate signed distance of points, negative inside."""

    def __init__(self, field: Field, lo: Array, hi: Array, step: float) -> None:
        """`field` of points (N, 3) [m] is (N,) [m]; the box [lo, hi] is tight; `step` [m] is for differences."""
        self.field, self.step = field, step
        self.bounds = lo, hi
        self.volume: float | None = None

    def distance(self, axes: list[Array]) -> Array:
        """Signed distances on a grid: the field, near the surface over its slope, which need not be 1."""
        d = on_grid(self.field, axes)
        near = np.abs(d) < 3.0 * (axes[0][1] - axes[0][0])
        value, gradient = slope(self.field, points(axes, np.argwhere(near)), self.step)
        # On a ridge differences are too small: there the distance is not made larger than the field by much.
        d[near] = value / np.clip(np.linalg.norm(gradient, axis=1), 0.6, 3.0)
        return d

    def contains(self, axes: list[Array], index: Array) -> Array:
        """Whether grid points (M, 3) are inside, (M,) bool."""
        return self.field(points(axes, index)) < 0

    def settle(self, P: Array, depth: float) -> tuple[Array, Array]:
        """Newton's steps along the gradient to `depth` [m]; see `fracsim.asset.fill.Solid`."""
        Q, normal, miss = settle(self.field, P, depth, self.step)
        lost = miss > 0.1 * depth
        if lost.any():
            Q[lost], normal[lost] = self._deepest(P[lost], depth)
        return Q, normal

    def _deepest(self, P: Array, depth: float) -> tuple[Array, Array]:
        """Points (N, 3) moved to the deepest place on the way from the surface to `depth` [m], and the normals."""
        S, normal, _ = settle(self.field, P, 0.0, self.step)
        way = np.linspace(0.0, depth, 9)
        values = np.stack([self.field(S - t * normal) for t in way], axis=1)
        Q = S - way[values.argmin(axis=1), None] * normal
        return np.where(values.min(axis=1)[:, None] < 0, Q, np.nan), normal


def on_grid(field: Field, axes: list[Array]) -> Array:
    """A field on the grid of three coordinate arrays."""
    out = np.empty([len(a) for a in axes], np.float32)
    for rows in slabs(axes):
        grid = np.stack(np.meshgrid(axes[0][rows], *axes[1:], indexing="ij"), axis=-1)
        out[rows] = field(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    return out


def slope(field: Field, P: Array, step: float) -> tuple[Array, Array]:
    """Value (N,) and gradient (N, 3) of a field from the corners of a tetrahedron about P."""
    values = np.stack([field(P + step * c) for c in CORNERS], axis=1).astype(np.float64)
    return values.mean(axis=1), values @ CORNERS / (4 * step)


def settle(field: Field, P: Array, depth: float, step: float, rounds: int = 5) -> tuple[Array, Array, Array]:
    """Points moved to `depth` below the surface, unit normals there, and what is left to go, (N,)."""
    P, todo = P.astype(np.float64), np.arange(len(P))
    normal, left = np.zeros_like(P), np.full(len(P), np.inf)
    for _ in range(rounds):
        value, g = slope(field, P[todo], step)
        length = np.maximum(np.linalg.norm(g, axis=1), 0.1)
        normal[todo] = g / np.maximum(np.linalg.norm(g, axis=1), 1e-12)[:, None]
        go = value / length + depth
        left[todo] = np.abs(go)
        P[todo] -= np.clip(go, -4 * step, 4 * step)[:, None] * normal[todo]
        todo = todo[left[todo] > 0.02 * step]
    return P, normal, left


def tight_box(field: Field, lo: Array, hi: Array) -> tuple[Array, Array]:
    """The bounding box of the surface of a solid that lies within [lo, hi], to about 1e-3 of its extent."""
    pitch = float(np.max(hi - lo)) / 40
    axes = [np.arange(a - pitch, b + 1.5 * pitch, pitch) for a, b in zip(lo, hi, strict=True)]
    near = points(axes, np.argwhere(np.abs(on_grid(field, axes)) < pitch))
    S = _on_surface(field, near, pitch / 8)
    for _ in range(2):
        pitch /= 4
        local = pitch * np.stack(np.meshgrid(*[np.arange(-3, 4)] * 3), axis=-1).reshape(-1, 3)
        order = np.argsort(S, axis=0)
        ends = np.unique(np.concatenate([order[:8], order[-8:]]))
        S = np.concatenate([S[ends], _on_surface(field, (S[ends, None] + local).reshape(-1, 3), pitch / 2)])
    return S.min(axis=0), S.max(axis=0)


def _on_surface(field: Field, P: Array, step: float) -> Array:
    """Those of the points (N, 3) that reach the surface, there."""
    S, _, left = settle(field, P, 0.0, step)
    return S[left < 0.1 * step]


def measure(field: Field, lo: Array, hi: Array) -> tuple[float, float]:
    """Rough volume and surface area of a solid within [lo, hi]."""
    pitch = float(np.max(hi - lo)) / 48
    axes = [np.arange(a - pitch, b + 1.5 * pitch, pitch) for a, b in zip(lo, hi, strict=True)]
    d = on_grid(field, axes)
    return float((d < 0).sum()) * pitch**3, float((np.abs(d) < pitch).sum()) * pitch**2 / 2
