"""Fills a solid with material points: a regular lattice inside, a layer that follows the surface, true volumes.

Lengths below are in lattice spacings. The lattice keeps INTERIOR below the surface. The lattice points from there to
one spacing further out are one a unit area of the surface: they settle at the depth SKIN below it, spread evenly and
make the outermost layer. Both together are one particle a lattice cell, without stairs in the outline.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from fracsim.records import Array

SKIN = 0.25
"""Depth of the surface particles."""
INTERIOR = 0.75
"""Least depth of the lattice particles."""
CLOSEST = 0.55
"""Surface particles nearer than this to another particle are dropped."""
REPULSION = 1.1
"""Distance below which surface particles push each other apart."""
SMALLEST = 0.1
"""Particles of less volume are merged into their neighbour: a tiny mass is unstable."""
FULL = 1.5
"""Lattice cells from this depth on are wholly owned by their lattice point."""
THIN = 1.5
"""Distance from the nearest particle beyond which volume counts as not resolved."""
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
        """The volume where it is known exactly [m^3]; asked for after `distance`."""

    def distance(self, axes: list[Array]) -> Array:
        """Signed distances on the grid of three coordinate arrays, negative inside, right within 2 grid steps."""

    def contains(self, axes: list[Array], index: Array) -> Array:
        """Whether the points `index`, (M, 3), of the grid of three coordinate arrays are inside, (M,) bool."""

    def settle(self, P: Array, depth: float) -> tuple[Array, Array]:
        """Points (N, 3) moved to `depth` [m] below the nearest surface, and outward normals there, (N, 3).

        Where the solid is too thin for that they go as deep as they can; NaN marks a point that got nowhere. A zero
        normal means that none is known.
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
    remarks: tuple[str, ...] = ()
    """What a user should know."""


def fill(solid: Solid, spacing: float) -> Filling:
    """Particles that fill a solid at a distance of `spacing` [m]; there may be none."""
    axes = lattice(*solid.bounds, spacing)
    d = solid.distance(axes) / spacing
    core = d <= -INTERIOR
    inner, depth = points(axes, np.argwhere(core)), -d[core]
    band = points(axes, np.argwhere(~core & (d < 1 - INTERIOR)))
    skin, normal = _surface(solid, band, inner[depth < INTERIOR + 2], spacing)
    X = np.concatenate([skin, inner])
    surface = np.arange(len(X)) < len(skin)
    depth = np.concatenate([np.full(len(skin), SKIN), depth])
    volume, remarks = _volumes(solid, axes, d, X, np.where(surface, 0.0, depth), spacing)
    normal = np.concatenate([normal, np.zeros_like(inner)])
    keep = volume > 0
    return Filling(X[keep], volume[keep], depth[keep] * spacing, normal[keep], surface[keep], remarks)


def lattice(lo: Array, hi: Array, spacing: float) -> list[Array]:
    """Three coordinate arrays of a lattice centred on the box [lo, hi], wider than it by three points on each side.

    Of the two centred lattices that an axis has, the one is taken whose outermost points inside lie one spacing below
    the surface particles of a face of the box.
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
    P, normal = _settled(solid, band, spacing)
    for _ in range(2 if len(P) else 0):
        for _ in range(3):
            P = P + _repulsion(P, normal, inner, spacing)
        P, normal = _settled(solid, P, spacing)
    keep = _apart(P, inner, CLOSEST * spacing)
    return P[keep], normal[keep]


def _settled(solid: Solid, P: Array, spacing: float) -> tuple[Array, Array]:
    """Those of the points that settle at the depth SKIN, there, and the normals."""
    Q, normal = solid.settle(P, SKIN * spacing)
    there = np.isfinite(Q).all(axis=1)
    return Q[there], normal[there]


def _repulsion(P: Array, normal: Array, inner: Array, spacing: float) -> Array:
    """One step (N, 3) along the surface, away from near neighbours; a point without a normal stays."""
    reach = REPULSION * spacing
    every = np.concatenate([P, inner])
    i, j = _pairs(every, reach).T
    i, j = i[i < len(P)], j[i < len(P)]
    apart = every[i] - every[j]
    gap = np.maximum(np.linalg.norm(apart, axis=1), 1e-3 * spacing)
    push = apart * (0.3 * (reach - gap) / gap)[:, None]
    sums = [np.bincount(i, p, len(every)) - np.bincount(j, p, len(every)) for p in push.T]
    step = np.stack(sums, axis=1)[: len(P)]
    step -= np.einsum("ij,ij->i", step, normal)[:, None] * normal
    step[(normal == 0).all(axis=1)] = 0.0
    return np.clip(step, -0.25 * spacing, 0.25 * spacing)


def _pairs(P: Array, reach: float) -> Array:
    """Pairs i < j of points (N, 3) nearer than `reach`, (M, 2)."""
    found: Array = cKDTree(P).query_pairs(reach, output_type="ndarray")
    return found


def _apart(P: Array, inner: Array, least: float) -> Array:
    """Which points to keep, (N,) bool, so that none is nearer than `least` to another or to `inner`."""
    keep = np.ones(len(P), bool)
    pairs = _pairs(np.concatenate([inner, P]), least) - len(inner)
    for i, j in pairs[np.lexsort(pairs.T)]:
        if j >= 0 and keep[j] and (i < 0 or keep[i]):
            keep[j] = False
    return keep


def _volumes(
    solid: Solid, axes: list[Array], d: Array, X: Array, depth: Array, spacing: float
) -> tuple[Array, tuple[str, ...]]:
    """Volume of each particle, zero for those merged away, and a remark on what is too thin.

    Cells at least FULL below the surface belong to their lattice point; of others each sample that is inside belongs
    to the nearest particle. `depth` (N,) is in spacings, 0 on the surface.
    """
    volume = (depth >= FULL).astype(float)
    cells = np.argwhere((d > -FULL) & (d < HALF_DIAGONAL))
    near = np.flatnonzero(depth < FULL + 1.5)
    if not len(near):
        return volume, ()
    tree, thin = cKDTree(X[near]), 0.0
    for start in range(0, len(cells), CHUNK):
        reach, owner = tree.query(_samples(solid, axes, d, cells[start : start + CHUNK], spacing))
        volume += np.bincount(near[owner], minlength=len(X)) / SAMPLES**3
        thin += float((reach > THIN * spacing).sum()) / SAMPLES**3
    share = thin / max(volume.sum(), 1e-9)
    volume = _merged(X, volume) * spacing**3
    if solid.volume is not None and volume.any():
        volume *= solid.volume / volume.sum()
    return volume, () if share < 0.01 else (_thin(share),)


def volume(solid: Solid, spacing: float) -> float:
    """The volume [m^3] that `fill` divides among the particles: exact where it is known, else that of the samples."""
    axes = lattice(*solid.bounds, spacing)
    d = solid.distance(axes) / spacing
    if solid.volume is not None:
        return solid.volume
    cells = np.argwhere((d > -FULL) & (d < HALF_DIAGONAL))
    chunks = (cells[start : start + CHUNK] for start in range(0, len(cells), CHUNK))
    samples = sum(len(_samples(solid, axes, d, chunk, spacing)) for chunk in chunks)
    return float((d <= -FULL).sum() + samples / SAMPLES**3) * spacing**3


def _thin(share: float) -> str:
    return f"{share:.0%} of the volume is too thin for the particle spacing: raise solver.cells or asset.size."


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
    tiny = volume < SMALLEST
    if not tiny.any() or tiny.all():
        return volume
    large = np.flatnonzero(~tiny)
    _, to = cKDTree(X[large]).query(X[tiny])
    out: Array = np.where(tiny, 0.0, volume)
    out[large] += np.bincount(to, volume[tiny], len(large))
    return out
