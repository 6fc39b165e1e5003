"""Welding of vertices that a file splits at texture seams; whether the triangles then form a closed surface."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fracsim.asset import orient
from fracsim.records import Array

TOLERANCE = 1e-6
"""Vertices nearer than this, relative to the largest extent, are welded."""


@dataclass(frozen=True)
class Mesh:
    """Triangles without duplicates, and the properties of their edges."""

    corners: Array
    """Positions [m], (T, 3, 3)."""
    closed: bool
    """Whether every edge has a partner."""
    oriented: bool
    """Whether neighbours agree on the outward side."""

    @property
    def volume(self) -> float:
        """Volume [m^3] within a closed, oriented surface."""
        a, b, c = (self.corners - self.corners.mean(axis=(0, 1))).transpose(1, 0, 2)
        return abs(float(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6

    @property
    def rough(self) -> tuple[float, float]:
        """Estimates of volume [m^3], at most that of the bounding box, and area [m^2]."""
        a, b, c = self.corners.transpose(1, 0, 2)
        box = float(np.prod(np.ptp(self.corners, axis=(0, 1))))
        return min(self.volume, box), float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2


def weld(corners: Array) -> Mesh:
    """The mesh of triangles (T, 3, 3), consistently oriented if possible."""
    positions, faces = _faces(corners)
    uses, balance = _edges(faces)
    if (balance[uses == 2] != 0).any():
        faces = _turned(positions, faces)
        uses, balance = _edges(faces)
    oriented = not (balance[uses == 2] != 0).any()
    if oriented:
        faces = orient.outward(positions, faces, joined(directed(faces)[0]))
    closed = bool((balance == 0).all() if oriented else (uses % 2 == 0).all())
    return Mesh(positions[faces], closed, oriented)


def numbered(corners: Array, origin: Array, size: float) -> tuple[Array, Array]:
    """Index of a corner at each welded vertex, (V,), and vertex numbers of triangles (T, 3, 3), (T, 3).

    The largest extent is `size`; corners outside of the cube at `origin` (3,) are moved to its sides.
    """
    steps = np.round((corners.reshape(-1, 3) - origin) / (TOLERANCE * size))
    # 1 / TOLERANCE steps fit in 21 bits an axis, so that one integer stands for a position.
    code = np.clip(steps, 0, (1 << 21) - 1).astype(np.int64) @ (1 << np.array([42, 21, 0]))
    _, first, vertex = np.unique(code, return_index=True, return_inverse=True)
    return first, vertex.reshape(-1, 3)


def _faces(corners: Array) -> tuple[Array, Array]:
    """Welded positions (V, 3), and triangles (F, 3) of their indices, of corners (T, 3, 3).

    Collapsed and repeated triangles are left out.
    """
    P = corners.reshape(-1, 3)
    first, faces = numbered(corners, P.min(axis=0), float(np.ptp(P, axis=0).max()))
    order = np.sort(faces, axis=1)
    faces = faces[(order[:, 0] < order[:, 1]) & (order[:, 1] < order[:, 2])]
    _, once = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return P[first], faces[np.sort(once)]


def directed(faces: Array) -> tuple[Array, Array]:
    """Undirected edge number, (F, 3), and direction +1 or -1, (F, 3), of each side of triangles (F, 3)."""
    a, b = faces, np.roll(faces, -1, axis=1)
    key = np.minimum(a, b) * np.int64(faces.max() + 1) + np.maximum(a, b)
    return np.unique(key, return_inverse=True)[1].reshape(faces.shape), np.where(a < b, 1, -1)


def joined(edge: Array) -> Array:
    """Number of the part of each triangle, (F,), of the edge numbers of its sides (F, 3): a shared edge joins."""
    flat = edge.ravel()
    order = np.argsort(flat, kind="stable")
    p, q = order[:-1], order[1:]
    same = flat[p] == flat[q]
    ends = p[same] // 3, q[same] // 3
    graph = coo_matrix((np.ones(len(ends[0])), ends), shape=(len(edge), len(edge)))
    part: Array = connected_components(graph, directed=False)[1]
    return part


def _edges(faces: Array) -> tuple[Array, Array]:
    """Number of triangles (F, 3) at each undirected edge, (E,), and the sum of their directions, (E,)."""
    edge, direction = directed(faces)
    return np.bincount(edge.ravel()), np.rint(np.bincount(edge.ravel(), direction.ravel())).astype(int)


def _turned(positions: Array, faces: Array) -> Array:
    """Triangles `faces` (F, 3) of positions (V, 3), flipped so that neighbours agree and volumes are positive, (F, 3).

    Each triangle is two nodes of a graph, as it is and flipped. Neighbours are joined in the states that agree. A
    component of the graph is one consistent orientation; the opposite one is another component.
    """
    n = len(faces)
    edge, direction = (a.ravel() for a in directed(faces))
    order = np.argsort(edge, kind="stable")
    p, q = order[:-1], order[1:]
    two = (edge[p] == edge[q]) & (np.bincount(edge)[edge[p]] == 2)
    p, q = p[two], q[two]
    f, g, clash = p // 3, q // 3, (direction[p] == direction[q]).astype(int)
    ends = np.concatenate([f, f + n]), np.concatenate([g + n * clash, g + n * (1 - clash)])
    graph = coo_matrix((np.ones(2 * len(f)), ends), shape=(2 * n, 2 * n))
    _, state = connected_components(graph, directed=False)
    asis, flipped = state[:n], state[n:]
    faces = np.where((asis > flipped)[:, None], faces[:, ::-1], faces)
    body = np.minimum(asis, flipped)
    a, b, c = positions[faces].transpose(1, 0, 2) - positions.mean(axis=0)
    volume = np.bincount(body, np.einsum("ij,ij->i", a, np.cross(b, c)))
    turned: Array = np.where((volume[body] < 0)[:, None], faces[:, ::-1], faces)
    return turned
