"""The nearest point of a triangle surface: a tree over samples finds the candidates, exact arithmetic decides."""

import numpy as np

from fracsim.records import Array


class Nearest:
    """Queries for the nearest surface point."""

    def __init__(self, corners: Array, pitch: float) -> None:
        """`corners` (T, 3, 3) of triangles with area; samples lie about `pitch` apart on larger ones."""
        self.corners = corners
        self.samples, self.face = _sampled(corners, pitch)
        self._plant()

    def _plant(self) -> None:
        from scipy.spatial import cKDTree

        self.tree = cKDTree(self.samples)

    def drop(self, buried: Array) -> None:
        """Forgets samples, (S,) bool, so that their part of the surface is no longer found."""
        self.samples, self.face = self.samples[~buried], self.face[~buried]
        self._plant()

    def __call__(self, P: Array, candidates: int = 8) -> tuple[Array, Array, Array]:
        """Nearest points (N, 3), their triangles (N,) and barycentric coordinates (N, 3) of points (N, 3)."""
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
    """Points (S, 3) on a triangular grid on each triangle, its edges at most `pitch` long, and their triangles (S,)."""
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    parts = np.clip(np.ceil(edge / pitch).astype(int), 1, 512)
    samples, faces = [], []
    for n in np.unique(parts):
        mine = np.flatnonzero(parts == n)
        i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
        # Centres of the upward small triangles: none is shared with a neighbour.
        w = np.stack([i + 1 / 3, j + 1 / 3], axis=-1)[i + j < n] / n
        bary = np.concatenate([w, 1 - w.sum(axis=1, keepdims=True)], axis=1)
        samples.append(np.einsum("sc,tcj->tsj", bary, corners[mine]).reshape(-1, 3))
        faces.append(np.repeat(mine, len(bary)))
    return np.concatenate(samples), np.concatenate(faces)


def _barycentric(corners: Array, P: Array) -> Array:
    """Barycentric coordinates (N, 3) of the point of triangle n, (N, 3, 3), that is nearest to P[n], (N, 3)."""
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
    """Barycentric coordinates (N, 3) of the nearest points on the triangles' edges."""
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
    out: Array = np.einsum("ij,ij->i", a, b)
    return out
