"""Fills a solid with material points: a regular lattice inside, a layer that follows the surface, true volumes.

All lengths below are in lattice spacings. The lattice keeps INTERIOR below the surface. Lattice points between there
and one spacing further out are one a unit area of the surface: they settle at the depth SKIN below it, spread evenly,
and make the outermost layer. Both layers together are one particle a lattice cell, with no stairs in the outline.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fracsim.records import Array

SKIN = 0.25
"""Depth of the surface particles."""
INTERIOR = 0.75
"""Least depth of the lattice particles."""
CLOSEST = 0.55
"""Surface particles nearer than this to another particle are dropped."""
SMALLEST = 0.1
"""Particles of less volume are merged into their neighbour: a tiny mass is unstable."""
FULL = 1.5
"""Lattice cells from this depth on are wholly owned by their lattice point."""
SAMPLES = 4
"""Inside tests along each edge of a boundary cell."""
HALF_DIAGONAL = 0.87
CHUNK = 1 << 14  # boundary cells worked on at a time: bounds the memory of the inside tests


class Solid(Protocol):
    """What can be filled: something with an inside and a nearest surface, in the world [m]."""

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper corner of the bounding box, each (3,)."""

    @property
    def volume(self) -> float | None:
        """The volume where it is known exactly [m^3]."""

    def distance(self, axes: list[Array]) -> Array:
        """Signed distances on the grid of three coordinate arrays, negative inside, right within 2 grid steps."""

    def contains(self, axes: list[Array], index: Array) -> Array:
        """Whether the points `index`, (M, 3), of the grid of three coordinate arrays are inside, (M,) bool."""

    def settle(self, P: Array, depth: float) -> tuple[Array, Array]:
        """Points, (N, 3), moved to `depth` [m] below the nearest surface, and outward normals there, (N, 3).

        A point inside that cannot get there stays, one outside becomes NaN. No normal is known where it is zero.
        """


@dataclass(frozen=True)
class Filling:
    """Material points of a solid at rest."""

    X: Array
    """Positions [m], (N, 3)."""
    volume: Array
    """Volumes [m^3], (N,)."""
    depth: Array
    """Distances below the surface [m], (N,)."""
    normal: Array
    """Outward unit normals of surface particles, (N, 3), zero where none is known."""
    surface: Array
    """Whether the particle is of the outermost layer, (N,) bool."""
    thin: float
    """Fraction of the volume that is further than 1.5 spacings from any particle, as in walls thinner than one."""


def fill(solid: Solid, spacing: float) -> Filling:
    """Particles that fill a solid at a distance of `spacing` [m]; there may be none."""
    axes = lattice(*solid.bounds, spacing)
    d = solid.distance(axes) / spacing
    core = d <= -INTERIOR
    inner = points(axes, np.argwhere(core))
    band = points(axes, np.argwhere(~core & (d < 1 - INTERIOR)))
    skin, normal = _surface(solid, band, inner[-d[core] < INTERIOR + 2], spacing)
    X = np.concatenate([skin, inner])
    surface = np.arange(len(X)) < len(skin)
    depth = np.concatenate([np.full(len(skin), SKIN * spacing), -d[core] * spacing])
    normal = np.concatenate([normal, np.zeros_like(inner)])
    volume, thin = _volumes(solid, axes, d, X, surface, spacing)
    keep = volume > 0
    return Filling(X[keep], volume[keep], depth[keep], normal[keep], surface[keep], thin)


def lattice(lo: Array, hi: Array, spacing: float) -> list[Array]:
    """Three coordinate arrays of a lattice centred on the box [lo, hi], three points wider than it on each side.

    Of the two centred lattices an axis has, the one is taken whose outermost points lie one spacing below the surface
    particles of a face of the box.
    """
    count = np.maximum(np.round((hi - lo) / spacing - 2 * (1 + SKIN) + 1), 1) + 6
    return [c + spacing * (np.arange(n) - (n - 1) / 2) for c, n in zip((lo + hi) / 2, count, strict=True)]


def points(axes: list[Array], index: Array) -> Array:
    """Grid points (M, 3) of indices (M, 3)."""
    return np.stack([a[i] for a, i in zip(axes, index.T, strict=True)], axis=1)


def slabs(axes: list[Array]) -> list[slice]:
    """Slices of the first axis of a grid that hold about a million points each: they bound the memory."""
    rows = max(1, (1 << 20) // (len(axes[1]) * len(axes[2])))
    return [slice(i, i + rows) for i in range(0, len(axes[0]), rows)]


def _surface(solid: Solid, band: Array, inner: Array, spacing: float) -> tuple[Array, Array]:
    """Surface particles and their normals from the lattice points next to the surface, clear of `inner`."""
    P, normal = solid.settle(band, SKIN * spacing)
    there = np.isfinite(P).all(axis=1)
    P, normal = P[there], normal[there]
    for _ in range(2):
        for _ in range(3):
            P = P + _repulsion(P, normal, inner, spacing)
        Q, n = solid.settle(P, SKIN * spacing)
        there = np.isfinite(Q).all(axis=1)
        P, normal = Q[there], n[there]
    keep = _apart(P, inner, CLOSEST * spacing)
    return P[keep], normal[keep]


def _repulsion(P: Array, normal: Array, inner: Array, spacing: float) -> Array:
    """One step along the surface away from neighbours nearer than 1.1 spacings, (N, 3)."""
    from scipy.spatial import cKDTree

    reach = 1.1 * spacing
    every = np.concatenate([P, inner])
    pairs = cKDTree(every).query_pairs(reach, output_type="ndarray")
    pairs = pairs[pairs[:, 0] < len(P)]
    apart = every[pairs[:, 0]] - every[pairs[:, 1]]
    gap = np.maximum(np.linalg.norm(apart, axis=1), 1e-3 * spacing)
    push = apart * (0.3 * (reach - gap) / gap)[:, None]
    step = np.stack([_scatter(pairs, push[:, k], len(every)) for k in range(3)], axis=1)[: len(P)]
    step -= np.einsum("ij,ij->i", step, normal)[:, None] * normal
    # A particle without a normal has no surface to slide along.
    step *= np.any(normal != 0, axis=1)[:, None]
    return np.clip(step, -0.25 * spacing, 0.25 * spacing)


def _scatter(pairs: Array, push: Array, n: int) -> Array:
    """Sum over pairs of +push on the first and -push on the second of n points."""
    total: Array = np.bincount(pairs[:, 0], push, n) - np.bincount(pairs[:, 1], push, n)
    return total


def _apart(P: Array, inner: Array, least: float) -> Array:
    """Which points to keep, (N,) bool, so that no kept one is nearer than `least` to another or to `inner`."""
    from scipy.spatial import cKDTree

    keep = np.ones(len(P), bool)
    pairs = cKDTree(np.concatenate([inner, P])).query_pairs(least, output_type="ndarray") - len(inner)
    for i, j in pairs[np.lexsort(pairs.T)]:
        if j >= 0 and keep[j] and (i < 0 or keep[i]):
            keep[j] = False
    return keep


def _volumes(
    solid: Solid, axes: list[Array], d: Array, X: Array, surface: Array, spacing: float
) -> tuple[Array, float]:
    """Volume of each particle, zero for those merged away, and the thin fraction (see Filling)."""
    from scipy.spatial import cKDTree

    core = np.flatnonzero((d <= -INTERIOR).ravel())
    volume = np.zeros(len(X))
    volume[~surface] = d.ravel()[core] <= -FULL
    whole = volume.sum()
    near = np.flatnonzero(surface | (np.concatenate([np.zeros(surface.sum()), d.ravel()[core]]) > -FULL - 1.5))
    tree = cKDTree(X[near]) if len(near) else None
    far = 0
    cells = np.argwhere((d > -FULL) & (d < HALF_DIAGONAL))
    for start in range(0, len(cells) if tree else 0, CHUNK):
        inside = _samples(solid, axes, d, cells[start : start + CHUNK], spacing)
        reach, owner = tree.query(inside)
        volume += np.bincount(near[owner], minlength=len(X)) / SAMPLES**3
        far += int((reach > 1.5 * spacing).sum())
    total = volume.sum()
    volume = _merged(X, volume) * spacing**3
    if solid.volume is not None and total > 0:
        volume *= solid.volume / volume.sum()
    return volume, far / SAMPLES**3 / max(total, whole, 1.0)


def _samples(solid: Solid, axes: list[Array], d: Array, cells: Array, spacing: float) -> Array:
    """The samples of boundary cells (M, 3) that are inside the solid, (K, 3) [m]."""
    offsets = spacing * ((np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5)
    fine = [(a[:, None] + offsets).ravel() for a in axes]
    sub = np.stack(np.meshgrid(*[np.arange(SAMPLES)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    index = (SAMPLES * cells[:, None, :] + sub).reshape(-1, 3)
    unsure = np.repeat(d[tuple(cells.T)] > -HALF_DIAGONAL, SAMPLES**3)
    inside = ~unsure
    inside[unsure] = solid.contains(fine, index[unsure])
    return points(fine, index[inside])


def _merged(X: Array, volume: Array) -> Array:
    """Volumes, in cells, after those below SMALLEST went to the nearest larger particle."""
    from scipy.spatial import cKDTree

    tiny = volume < SMALLEST
    if not tiny.any() or tiny.all():
        return volume
    large = np.flatnonzero(~tiny)
    _, to = cKDTree(X[large]).query(X[tiny])
    out: Array = np.where(tiny, 0.0, volume)
    out[large] += np.bincount(to, volume[tiny], len(large))
    return out
