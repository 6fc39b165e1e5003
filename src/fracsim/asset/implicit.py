"""Solids given by a signed distance: bounding box, distances on a grid, steps to the surface."""

from collections.abc import Callable

import numpy as np

from fracsim.asset.fill import points, slabs
from fracsim.records import Array

Field = Callable[[Array], Array]
"""Signed distances (N,) at points (N, 3), negative inside."""
CORNERS = np.array([[1, -1, -1], [-1, -1, 1], [-1, 1, -1], [1, 1, 1]], np.float32)


class Implicit:
    """A `fracsim.asset.fill.Solid` given by an approximate signed distance."""

    def __init__(self, field: Field, lo: Array, hi: Array, step: float) -> None:
        """`field` is in metres. [lo, hi], (3,) each, is the bounding box [m]; `step` [m] is that of differences."""
        self.field, self.step = field, step
        self.bounds = lo, hi
        self.volume: float | None = None

    def distance(self, axes: list[Array]) -> Array:
        """Signed distances [m], (nx, ny, nz), on the grid of three coordinate arrays.

        Near the surface the field is divided by its slope, since the slope of a given field need not be 1.
        """
        d = on_grid(self.field, axes)
        near = np.abs(d) < 3.0 * (axes[0][1] - axes[0][0])
        value, gradient = slope(self.field, points(axes, np.argwhere(near)), self.step)
        # On a ridge difference quotients are too small: the lower limit keeps the distance near the field.
        d[near] = value / np.clip(np.linalg.norm(gradient, axis=1), 0.6, 3.0)
        return d

    def contains(self, axes: list[Array], index: Array) -> Array:
        """Whether the points with indices (M, 3) of the grid of three coordinate arrays are inside, (M,) bool."""
        return self.field(points(axes, index)) < 0

    def settle(self, P: Array, depth: float) -> tuple[Array, Array]:
        """Points (N, 3) moved to `depth` [m] below the surface by Newton's method, and normals there, (N, 3)."""
        Q, normal, miss = settle(self.field, P, depth, self.step)
        lost = miss > 0.1 * depth
        if lost.any():
            Q[lost], normal[lost] = self._deepest(P[lost], depth)
        return Q, normal

    def _deepest(self, P: Array, depth: float) -> tuple[Array, Array]:
        """Points (N, 3) moved to the deepest place between the surface and `depth` [m], and normals there, (N, 3)."""
        S, normal, _ = settle(self.field, P, 0.0, self.step)
        depths = np.linspace(0.0, depth, 9)
        values = np.stack([self.field(S - t * normal) for t in depths], axis=1)
        Q = S - depths[values.argmin(axis=1), None] * normal
        return np.where(values.min(axis=1)[:, None] < 0, Q, np.nan), normal


def on_grid(field: Field, axes: list[Array]) -> Array:
    """A field, (nx, ny, nz) float32, on the grid of three coordinate arrays (nx,), (ny,), (nz,)."""
    out = np.empty([len(a) for a in axes], np.float32)
    for rows in slabs(axes):
        grid = np.stack(np.meshgrid(axes[0][rows], *axes[1:], indexing="ij"), axis=-1)
        out[rows] = field(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    return out


def slope(field: Field, P: Array, step: float) -> tuple[Array, Array]:
    """Value (N,) and gradient (N, 3) of a field at P (N, 3), from the corners of a tetrahedron about P."""
    values = np.stack([field(P + step * c) for c in CORNERS], axis=1).astype(np.float64)
    return values.mean(axis=1), values @ CORNERS / (4 * step)


def settle(field: Field, P: Array, depth: float, step: float, rounds: int = 5) -> tuple[Array, Array, Array]:
    """Points P (N, 3) moved to `depth` below the surface, unit normals there (N, 3), and remaining distances (N,)."""
    P, todo = P.astype(np.float64), np.arange(len(P))
    normal, left = np.zeros_like(P), np.full(len(P), np.inf)
    for _ in range(rounds):
        value, g = slope(field, P[todo], step)
        length = np.maximum(np.linalg.norm(g, axis=1), 0.1)
        normal[todo] = g / np.maximum(np.linalg.norm(g, axis=1), 1e-12)[:, None]
        distance = value / length + depth
        left[todo] = np.abs(distance)
        P[todo] -= np.clip(distance, -4 * step, 4 * step)[:, None] * normal[todo]
        todo = todo[left[todo] > 0.02 * step]
    return P, normal, left


def tight_box(field: Field, lo: Array, hi: Array) -> tuple[Array, Array]:
    """The bounding box, (3,) and (3,), of a solid within [lo, hi], (3,) each, to about 1e-3 of its extent."""
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
    """The points P (N, 3) moved to the surface, (M, 3), without those that do not reach it."""
    S, _, left = settle(field, P, 0.0, step)
    return S[left < 0.1 * step]


def measure(field: Field, lo: Array, hi: Array) -> tuple[float, float]:
    """Rough volume [m^3] and surface area [m^2] of a solid within [lo, hi], (3,) each [m]."""
    pitch = float(np.max(hi - lo)) / 48
    axes = [np.arange(a - pitch, b + 1.5 * pitch, pitch) for a, b in zip(lo, hi, strict=True)]
    d = on_grid(field, axes)
    return float((d < 0).sum()) * pitch**3, float((np.abs(d) < pitch).sum()) * pitch**2 / 2
