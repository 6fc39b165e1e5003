"""Which triangles are the object: stray ones, ground planes and the like are left out where they would decide its size.

A part, joined at edges, is flat if it encloses nothing. What is flat and reaches out of the box of the other parts is
left out, unless the flat parts enclose something together, as the six sides of a loose box do.
"""

import numpy as np

from fracsim.asset import weld
from fracsim.asset.orient import volumes
from fracsim.asset.rays import Rays
from fracsim.records import Array

FLAT = 0.005
"""An open part is flat if its volume about its centre is below this share of its area times its extent."""
NOTHING = 1e-9
"""A closed part is flat if its volume is below this share of the cube of its extent."""
REACH = 1e-3
"""What reaches out of a box by less than this share of its extent changes nothing."""
COARSE = 33
"""Grid points along the extent, to see whether parts enclose something together."""


def outliers(corners: Array) -> Array:
    """Which triangles (T, 3, 3) to leave out, (T,) bool; none if no part encloses anything by itself."""
    out = np.zeros(len(corners), bool)
    area, longest = _measures(corners)
    real = np.flatnonzero(area > 1e-12 * longest**2)
    if not len(real):
        return out
    part, open_ = _parts(corners[real])
    flat = _flat(corners[real], area[real], part, open_)
    if flat.all():
        return out
    solid = real[~flat[part]]
    beyond = _beyond(corners, corners[solid])
    reaching = np.zeros(len(flat), bool)
    reaching[part[beyond[real]]] = True
    left = (flat & reaching)[part]
    if left.any() and not _enclose(corners[real[left]]):
        out[real[left]] = True
    # Triangles of no area decide nothing, wherever they lie.
    out[(area <= 1e-12 * longest**2) & beyond] = True
    return out


def _measures(corners: Array) -> tuple[Array, Array]:
    """Areas and longest sides of triangles (T, 3, 3), (T,) each."""
    a, b, c = corners.transpose(1, 0, 2)
    sides = np.stack([np.linalg.norm(v, axis=1) for v in (b - a, c - b, a - c)])
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2, sides.max(axis=0)


def _parts(corners: Array) -> tuple[Array, Array]:
    """Number of the part of each triangle (T, 3, 3), (T,), and whether a part has an edge without partner, (parts,).

    Vertices are welded relative to the extent of most corners, and far ones only where they are equal, so that few far
    ones change nothing.
    """
    P = corners.reshape(-1, 3)
    lo, hi = np.quantile(P, (0.05, 0.95), axis=0)
    size = max(float((hi - lo).max()), 1e-6 * float(np.ptp(P, axis=0).max()))
    lo, size = lo - 0.4 * size, 1.8 * size
    vertex = weld.numbered(corners, lo, size)[1].ravel()
    far = ((P < lo) | (P > lo + size)).any(axis=1)
    vertex[far] = len(P) + np.unique(P[far], axis=0, return_inverse=True)[1].ravel()
    edge, _ = weld.directed(vertex.reshape(-1, 3))
    part = weld.joined(edge)
    open_ = np.zeros(part.max() + 1, bool)
    open_[part[(np.bincount(edge.ravel()) == 1)[edge].any(axis=1)]] = True
    return part, open_


def _flat(corners: Array, area: Array, part: Array, open_: Array) -> Array:
    """Whether each part encloses nothing, (parts,) bool.

    Of triangles (T, 3, 3) with areas (T,) and part numbers (T,); `open_` (parts,) as from `_parts`.
    """
    lo, hi = np.full((len(open_), 3), np.inf), np.full((len(open_), 3), -np.inf)
    np.minimum.at(lo, part, corners.min(axis=1))
    np.maximum.at(hi, part, corners.max(axis=1))
    extent = (hi - lo).max(axis=1)
    volume = np.abs(volumes(corners, part))
    out: Array = np.where(open_, volume < FLAT * np.bincount(part, area) * extent, volume < NOTHING * extent**3)
    return out


def _beyond(corners: Array, solid: Array) -> Array:
    """Whether triangles (T, 3, 3) reach out of the box of the triangles `solid` (S, 3, 3), (T,) bool."""
    lo, hi = solid.min(axis=(0, 1)), solid.max(axis=(0, 1))
    margin = REACH * float((hi - lo).max())
    out: Array = ((corners < lo - margin) | (corners > hi + margin)).any(axis=(1, 2))
    return out


def _enclose(corners: Array) -> bool:
    """Whether triangles (T, 3, 3), flat part by part, enclose something together."""
    lo, hi = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    pitch = float((hi - lo).max()) / (COARSE - 1)
    axes = [np.arange(a - pitch, b + 1.5 * pitch, pitch) for a, b in zip(lo, hi, strict=True)]
    index = np.argwhere(np.ones([len(a) for a in axes], bool))
    winding, _ = Rays(corners, axes, closed=False, oriented=False).winding(index)
    return bool((winding > 0.5).mean() > 1e-3)
