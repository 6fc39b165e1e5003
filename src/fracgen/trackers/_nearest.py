"""Queries that follow the nearest of given tracks."""

import numpy as np
from scipy.spatial import cKDTree

from fracsim.records import Array


def follow(xy: Array, visible: Array, queries: Array, radius: float) -> tuple[Array, Array]:
    """Queries (N, 2) in the first of T frames, moved as the nearest of M tracks xy (T, M, 2) that is seen there.

    visible (T, M) says where a track is seen. Returns positions (T, N, 2) float64 and whether they are seen (T, N)
    bool: never those of a query without a track within `radius` px, and none where its track is not finite.
    """
    visible = np.asarray(visible, bool) & np.isfinite(xy).all(axis=-1)
    known = np.flatnonzero(visible[0])
    xy = np.asarray(xy[:, known], np.float64)
    if not len(known):
        return np.full((len(xy), len(queries), 2), np.nan), np.zeros((len(xy), len(queries)), bool)
    distance, nearest = cKDTree(xy[0]).query(queries)
    tracks = queries + xy[:, nearest] - xy[0, nearest]
    return tracks, visible[:, known[nearest]] & (distance <= radius)
