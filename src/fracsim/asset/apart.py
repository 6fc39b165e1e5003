"""Which points of a cloud belong to the object: not stray ones, not small groups apart, not a background around it."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fracsim.records import Array

SMALL = 0.02
"""Separate groups with a smaller share of the points are stray."""
JOINED = 3
"""Occupied cells are joined up to this distance (two cells lie between them)."""
FAR = 3.0
"""A group that is this many times as wide as all that lies within it is a background: a sky, a dome, a studio."""


def coherent(means: Array) -> Array:
    """Whether a point (N, 3) belongs to the object, (N,) bool: neither far outside nor in a small separate group.

    What is joined to the largest group belongs to it, however thin and long it is.
    """
    lo, hi = np.quantile(means, (0.01, 0.99), axis=0)
    lo, hi = lo - 0.5 * (hi - lo), hi + 0.5 * (hi - lo)
    near: Array = ((means >= lo) & (means <= hi)).all(axis=1)
    part = _groups(means, near)
    share = np.bincount(part) / max(int(near.sum()), 1)
    main = np.bincount(part[near]).argmax()
    return np.asarray((near & (share >= SMALL)[part]) | (part == main))


def background(means: Array) -> Array:
    """Whether a point (N, 3) lies on a shell far around the rest, (N,) bool; none if there is no rest.

    The rest is no part of the shell, and the shell keeps clear of it: FAR times as wide, nothing within half of that.
    """
    part = _groups(means, np.ones(len(means), bool))
    groups = [np.flatnonzero(part == k) for k in np.unique(part)]
    groups.sort(key=lambda g: float(np.ptp(means[g], axis=0).max()))
    shell = np.zeros(len(means), bool)
    for k in range(1, len(groups)):
        core = np.concatenate(groups[:k])
        lo, hi = means[core].min(axis=0), means[core].max(axis=0)
        size = float((hi - lo).max())
        around = np.concatenate(groups[k:])
        gap = np.abs(means[around] - (lo + hi) / 2).max(axis=1).min()
        surrounds = (means[around].min(axis=0) < lo).all() and (means[around].max(axis=0) > hi).all()
        wide = float(np.ptp(means[around], axis=0).max()) > FAR * size
        if surrounds and wide and gap > 0.5 * FAR * size / 2 and len(core) >= SMALL * len(means):
            shell[around] = True
            return shell
    return shell


def _groups(means: Array, near: Array) -> Array:
    """Number of the group of each point (N, 3), (N,): occupied cells up to JOINED apart are one group.

    The cells are so wide that the points of one surface are connected: a surface of n^2 cells has about 16 points in
    each. Their number along the extent of the points with `near` (N,) is between 8 and 64.
    """
    lo, size = means[near].min(axis=0), float(np.ptp(means[near], axis=0).max())
    cells = np.clip(np.sqrt(near.sum()) / 4, 8, 64)
    scale = (cells - 1e-6) / max(size, 1e-300)
    # Points farther than a thousand extents away share the outermost cells.
    index = np.floor(np.clip((means - lo) * scale, -64e3, 64e3)).astype(np.int64)
    cell, of = np.unique(index, axis=0, return_inverse=True)
    i, j = cKDTree(cell).query_pairs(JOINED + 0.5, p=np.inf, output_type="ndarray").T
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(len(cell), len(cell)))
    part: Array = connected_components(graph, directed=False)[1][of.ravel()]
    return part
