"""The nearest point of a triangle surface: a tree of samples finds candidates, their exact distances decide."""

import numpy as np
from scipy.spatial import cKDTree

from fracsim.records import Array


class Nearest:
    """Queries for the nearest surface point."""

    def __init__(self, corners: Array, pitch: float) -> None:
        """`corners` (T, 3, 3) of triangles of positive area; samples lie about `pitch` apart on larger triangles."""
        self.corners = corners
        self.samples, self.face = _sampled(corners, pitch)
        self.tree = cKDTree(self.samples)

    def drop(self, buried: Array) -> None:
        """Removes the samples `buried`, (S,) bool, so that their part of the surface is no longer found."""
        self.samples, self.face = self.samples[~buried], self.face[~buried]
        self.tree = cKDTree(self.samples)

    def __call__(self, P: Array, candidates: int = 8) -> tuple[Array, Array, Array]:
        """Surface points nearest to P (N, 3): positions (N, 3), triangles (N,), barycentric coordinates (N, 3)."""
        k = min(candidates, len(self.samples))
        _, at = self.tree.query(P, k=k)
        face = self.face[at.reshape(len(P), k)]
        best, where, weight = np.full(len(P), np.inf), np.zeros(len(P), int), np.zeros((len(P), 3))
        for column in face.T:
            bary = _barycentric(self.corners[column], P)
            gap = np.linalg.norm(np.einsum("nc,ncj->nj", bary, self.corners[column]) - P, axis=1)
            better = gap < best
            best, where = np.where(better, gap, best), np.where(better, column, where)
            weight[better] = bary[better]
        return np.einsum("nc,ncj->nj", weight, self.corners[where]), where, weight


def _sampled(corners: Array, pitch: float) -> tuple[Array, Array]:
    """Points (S, 3) about `pitch` apart on triangles (T, 3, 3), and their triangles (S,).

    The points of a triangle lie in rows along its shortest edge.
    """
    facing = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1), axis=2)
    order = (facing.argmin(axis=1)[:, None] + np.arange(3)) % 3
    turned = np.take_along_axis(corners, order[:, :, None], axis=1)
    edges = np.stack([facing.max(axis=1), facing.min(axis=1)], axis=1)
    parts = np.clip(np.ceil(edges / pitch).astype(int), 1, 4096)
    kinds, kind = np.unique(parts, axis=0, return_inverse=True)
    members = np.split(np.argsort(kind.ravel(), kind="stable"), np.cumsum(np.bincount(kind.ravel()))[:-1])
    samples, faces = [], []
    for (rows, across), mine in zip(kinds, members, strict=True):
        bary = _rows(int(rows), int(across))
        samples.append(np.einsum("sc,tcj->tsj", bary, turned[mine]).reshape(-1, 3))
        faces.append(np.repeat(mine, len(bary)))
    return np.concatenate(samples), np.concatenate(faces)


def _rows(rows: int, across: int) -> Array:
    """Barycentric coordinates (S, 3) of `rows` rows of points from the first corner on, the last of `across` points."""
    u = (np.arange(rows) + 0.5) / rows
    count = np.maximum(np.ceil(u * across).astype(int), 1)
    u, count, first = (np.repeat(a, count) for a in (u, count, np.cumsum(count) - count))
    w = (np.arange(len(u)) - first + 0.5) / count
    return np.stack([1 - u, u * (1 - w), u * w], axis=1)


def _barycentric(corners: Array, P: Array) -> Array:
    """Barycentric coordinates (N, 3) of the points nearest to P (N, 3), each in its triangle of `corners` (N, 3, 3)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac, ap = b - a, c - a, P - a
    uu, uv, vv = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    up, vp = _dot(ab, ap), _dot(ac, ap)
    area = np.maximum(uu * vv - uv * uv, 1e-300)
    v, w = (vv * up - uv * vp) / area, (uu * vp - uv * up) / area
    bary = np.stack([1 - v - w, v, w], axis=1)
    out = (bary < 0).any(axis=1)
    bary[out] = _on_edges(corners[out], P[out])
    return bary


def _on_edges(corners: Array, P: Array) -> Array:
    """Barycentric coordinates (N, 3) of the points nearest to P (N, 3) on the edges of triangles (N, 3, 3)."""
    best, bary = np.full(len(P), np.inf), np.zeros((len(P), 3))
    for k in range(3):
        start, along = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        t = np.clip(_dot(P - start, along) / np.maximum(_dot(along, along), 1e-300), 0.0, 1.0)
        gap = np.linalg.norm(start + t[:, None] * along - P, axis=1)
        better = gap < best
        best[better] = gap[better]
        bary[better] = 0.0
        bary[better, k], bary[better, (k + 1) % 3] = 1 - t[better], t[better]
    return bary


def _dot(a: Array, b: Array) -> Array:
    """Scalar products (N,) of vectors (N, 3)."""
    out: Array = np.einsum("ij,ij->i", a, b)
    return out
