"""The outer side of each body of a surface: bodies that are inside out are turned, cavities stay."""

import numpy as np

from fracsim.records import Array

PROBES = 16
"""Corners of a body that tell whether it lies within another."""
NUDGE = np.array([1.234567e-7, 2.718281e-7])
"""Shift of the probes' rays [extents]: it keeps them off edges and corners."""


def outward(positions: Array, faces: Array, part: Array) -> Array:
    """Triangles `faces` (F, 3) of positions (V, 3), with the parts `part` (F,) turned that are inside out, (F, 3).

    A part that lies within no other has a positive volume. One that lies within another is turned with that, so that
    cavities stay cavities. Nothing is turned where all parts have the same sign.
    """
    volume = volumes(positions[faces], part)
    if not (volume.min() < 0 < volume.max()):
        return faces
    order = np.argsort(part, kind="stable")
    members = np.split(order, np.cumsum(np.bincount(part))[:-1])
    corners = positions[faces]
    lo, hi = (np.stack([f(corners[m], axis=(0, 1)) for m in members]) for f in (np.min, np.max))
    turn, larger = np.zeros(len(volume), bool), np.zeros(0, int)
    for k in np.argsort(-np.abs(volume), kind="stable"):
        around = larger[((lo[larger] <= lo[k]) & (hi[larger] >= hi[k])).all(axis=1)]
        P = positions[np.unique(faces[members[k]])]
        P = P[:: max(1, len(P) // PROBES)]
        container = next((j for j in around[::-1] if _within(P, corners[members[j]])), None)
        turn[k] = volume[k] < 0 if container is None else turn[container]
        larger = np.append(larger, k)
    out: Array = np.where(turn[part][:, None], faces[:, ::-1], faces)
    return out


def volumes(corners: Array, part: Array) -> Array:
    """Signed volumes of the parts of triangles (T, 3, 3) with numbers `part` (T,), each about its own centre, (parts,).

    For an open part it is that of the cone from its centre.
    """
    count = np.bincount(part)
    centre = np.stack([np.bincount(part, corners[:, :, k].mean(axis=1)) for k in range(3)], axis=1) / count[:, None]
    a, b, c = (corners - centre[part][:, None]).transpose(1, 0, 2)
    out: Array = np.bincount(part, np.einsum("ij,ij->i", a, np.cross(b, c))) / 6
    return out


def _within(P: Array, corners: Array) -> bool:
    """Whether all points P (N, 3) lie within the triangles (T, 3, 3): rays upward cross them more often one way."""
    lo, hi = corners.min(axis=1), corners.max(axis=1)
    shift = NUDGE * float((hi - lo).max())
    for point in P:
        x, y = point[:2] + shift
        at = np.flatnonzero(
            (lo[:, 0] <= x) & (x <= hi[:, 0]) & (lo[:, 1] <= y) & (y <= hi[:, 1]) & (hi[:, 2] > point[2])
        )
        a, b, c = corners[at].transpose(1, 0, 2)
        twice = _area(a, b, c[:, 0], c[:, 1])
        wa, wb, wc = _area(b, c, x, y), _area(c, a, x, y), _area(a, b, x, y)
        sign = np.sign(twice)
        hit = (sign != 0) & (sign * wa >= 0) & (sign * wb >= 0) & (sign * wc >= 0)
        z = (wa * a[:, 2] + wb * b[:, 2] + wc * c[:, 2]) / np.where(twice == 0, 1.0, twice)
        if abs(sign[hit & (z > point[2])].sum()) < 1:
            return False
    return True


def _area(a: Array, b: Array, x: Array | float, y: Array | float) -> Array:
    """Twice the signed areas (N,) of triangles a, b (N, 3) and x, y (N,) in the plane of the first two axes."""
    out: Array = (b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (b[:, 1] - a[:, 1]) * (x - a[:, 0])
    return out
