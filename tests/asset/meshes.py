"""Meshes made into particles, and what is asked of these."""

from pathlib import Path

import numpy as np
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fracsim.asset import gaussians, mesh
from fracsim.scene.vocab import Asset

SPACING = 0.02
DUCK = Path(__file__).parents[2] / ".." / "shared" / "data" / "Duck.glb"
BALL = trimesh.creation.icosphere(3)


def prepared(thing, path, spacing=SPACING, **fields):
    if thing is not None:
        thing.export(path)
    return mesh.prepare(Asset(kind="mesh", path=str(path), **fields), spacing, 0)


def scaled(volume, thing):
    """The volume of a mesh at asset.size = 0.6."""
    return volume * (0.6 / thing.extents.max()) ** 3


def colours(particles):
    return 0.5 + gaussians.SH_C0 * particles.sh[:, 0]


def hues(particles):
    """Surface colours over their largest component: the light is divided out."""
    rgb = colours(particles)[particles.surface]
    return rgb / rgb.max(axis=1, keepdims=True)


def pieces(particles, reach):
    """Sizes of the groups of particles that are connected by steps of `reach`, largest first."""
    pairs = cKDTree(particles.X).query_pairs(reach, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(particles), len(particles)))
    return np.sort(np.bincount(connected_components(graph, directed=False)[1]))[::-1]


def solid_angle_winding(corners, P):
    """The generalized winding number by the solid angles of triangles (Van Oosterom and Strackee 1983): the oracle."""
    total = np.zeros(len(P))
    for a, b, c in corners:
        A, B, C = a - P, b - P, c - P
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (A, B, C))
        dot = la * lb * lc + (A * B).sum(1) * lc + (B * C).sum(1) * la + (C * A).sum(1) * lb
        total += 2 * np.arctan2(np.einsum("ij,ij->i", A, np.cross(B, C)), dot)
    return total / (4 * np.pi)
