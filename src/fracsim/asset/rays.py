"""Whether points of a grid are inside a triangle surface, by signed crossings of the grid's own lines.

The signed number of crossings along a ray from a point is the winding number of a closed surface. For an open surface
it depends on the ray. Its mean over all directions is the generalized winding number (Jacobson, Kavan and Sorkine
2013), here estimated from the six directions along the axes. Without a consistent orientation the parity of the
crossings is used.
"""

from dataclasses import dataclass

import numpy as np

from fracsim.records import Array

CHUNK = 1 << 22
"""Pairs of a triangle and a grid line processed at a time."""
NUDGE = (1.234567e-6, 2.718281e-6)
"""Shifts of the grid lines [grid steps]: they keep lines off edges and vertices."""


class Rays:
    """The crossings of the lines of one grid with triangles."""

    def __init__(self, corners: Array, axes: list[Array], closed: bool, oriented: bool) -> None:
        """Triangles (T, 3, 3) and a grid of three coordinate arrays; for a closed surface one axis suffices."""
        self.axes, self.oriented = axes, oriented
        self.tables = [_Table.of(corners, axes, axis) for axis in ((2,) if closed else (0, 1, 2))]

    def winding(self, index: Array) -> tuple[Array, Array]:
        """Estimated winding numbers (M,) of grid points with indices (M, 3), and whether the rays disagree, (M,)."""
        votes = [vote for table in self.tables for vote in table.votes(self.axes, index, self.oriented)]
        total, least, most = votes[0].astype(float), votes[0], votes[0]
        for vote in votes[1:]:
            total, least, most = total + vote, np.minimum(least, vote), np.maximum(most, vote)
        return total / len(votes), least != most


@dataclass(frozen=True)
class _Table:
    """Crossings of the grid lines along one axis, ordered by line and place."""

    axis: int
    line: Array
    """Number of the grid line, (crossings,), ascending."""
    key: Array
    """Line plus place along it as a fraction, (crossings,), ascending."""
    cumulative: Array
    """Cumulative sum of the signs, (crossings + 1,)."""

    @staticmethod
    def of(corners: Array, axes: list[Array], axis: int) -> "_Table":
        """The crossings of triangles (T, 3, 3) with the lines along `axis` of the grid of three coordinate arrays."""
        line, place, sign = _crossings(corners, axes, axis)
        key = line + _fraction(place, axes[axis])
        order = np.argsort(key, kind="stable")
        return _Table(axis, line[order], key[order], np.concatenate([[0], np.cumsum(sign[order])]))

    def votes(self, axes: list[Array], index: Array, oriented: bool) -> tuple[Array, Array]:
        """Winding numbers of grid points with indices (M, 3), (M,) from the crossings ahead, (M,) from those behind.

        Parities if the surface is not oriented.
        """
        u, v = (self.axis + 1) % 3, (self.axis + 2) % 3
        line = index[:, u] * len(axes[v]) + index[:, v]
        at = np.searchsorted(self.key, line + _fraction(axes[self.axis], axes[self.axis])[index[:, self.axis]])
        first, last = np.searchsorted(self.line, line), np.searchsorted(self.line, line, side="right")
        if oriented:
            return self.cumulative[last] - self.cumulative[at], self.cumulative[first] - self.cumulative[at]
        return (last - at) % 2, (at - first) % 2


def _fraction(place: Array, axis: Array) -> Array:
    """Places (crossings,) along an axis, of coordinates (n,), as ascending numbers in (0, 1), (crossings,)."""
    span = axis[-1] - axis[0]
    out: Array = np.clip(0.5 + 0.25 * (place - (axis[0] + axis[-1]) / 2) / max(span, 1e-300), 1e-9, 1 - 1e-9)
    return out


def _crossings(corners: Array, axes: list[Array], axis: int) -> tuple[Array, Array, Array]:
    """Line number, place along the axis, and sign of every crossing, (crossings,) each.

    Of triangles (T, 3, 3) with the lines along `axis` of the grid of three coordinate arrays. The sign is +1 where the
    line leaves the inside.
    """
    u, v = (axis + 1) % 3, (axis + 2) % 3
    U, V = (axes[k] + n * (axes[k][1] - axes[k][0]) for k, n in zip((u, v), NUDGE, strict=True))
    lo, hi = corners.min(axis=1), corners.max(axis=1)
    i0, i1 = np.searchsorted(U, lo[:, u]), np.searchsorted(U, hi[:, u])
    j0, j1 = np.searchsorted(V, lo[:, v]), np.searchsorted(V, hi[:, v])
    pairs = (i1 - i0) * (j1 - j0)
    out: list[tuple[Array, Array, Array]] = [(np.zeros(0, int), np.zeros(0), np.zeros(0, int))]
    batch = np.cumsum(pairs) // CHUNK
    for every in np.split(np.arange(len(pairs)), np.flatnonzero(np.diff(batch)) + 1):
        part = every[pairs[every] > 0]
        t = np.repeat(part, pairs[part])
        k = np.arange(len(t)) - np.repeat(np.cumsum(pairs[part]) - pairs[part], pairs[part])
        width = (j1 - j0)[t]
        i, j = i0[t] + k // width, j0[t] + k % width
        hit, place, sign = _pierced(corners[t][:, :, [u, v, axis]], U[i], V[j])
        out.append(((i * len(V) + j)[hit], place[hit], sign[hit]))
    line, place, sign = (np.concatenate(a) for a in zip(*out, strict=True))
    return line, place, sign


def _pierced(corners: Array, p: Array, q: Array) -> tuple[Array, Array, Array]:
    """Whether lines at p, q, (M,) each, pass through triangles (M, 3, 3), their places and the signs of the triangles'
    normals, (M,) each.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    wa = (b[:, 0] - p) * (c[:, 1] - q) - (b[:, 1] - q) * (c[:, 0] - p)
    wb = (c[:, 0] - p) * (a[:, 1] - q) - (c[:, 1] - q) * (a[:, 0] - p)
    wc = twice - wa - wb
    sign = np.sign(twice).astype(int)
    hit = (sign != 0) & (sign * wa >= 0) & (sign * wb >= 0) & (sign * wc >= 0)
    place = (wa * a[:, 2] + wb * b[:, 2] + wc * c[:, 2]) / np.where(twice == 0, 1.0, twice)
    return hit, place, sign
