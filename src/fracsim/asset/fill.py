"""Fills a solid with material points: a regular lattice inside, a layer that follows the surface, true volumes.

Constants are in lattice spacings. Interior particles are lattice points at least INTERIOR below the surface. The next
layer of lattice points, one spacing thick, has one point per unit area of the surface. These are moved to the depth
SKIN and spread evenly: the outermost layer. So there is one particle a lattice cell, without stairs in the outline.
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
"""From this depth on a lattice cell belongs wholly to its lattice point."""
THIN = 1.5
"""Volume farther than this from the nearest particle counts as not resolved."""
SAMPLES = 4
"""Inside tests along each edge of a boundary cell."""
HALF_DIAGONAL = 0.87
"""Half the diagonal of a lattice cell, rounded up."""
CHUNK = 1 << 14
"""Boundary cells processed at a time: bounds the memory of the inside tests."""


class Solid(Protocol):
    """A body in the world [m] that can be filled. Grids are given by three coordinate arrays, (nx,), (ny,), (nz,)."""

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper corner of the bounding box, each (3,)."""

    @property
    def volume(self) -> float | None:
        """The exact volume [m^3], or None if unknown; valid after a call of `distance`."""

    def distance(self, axes: list[Array]) -> Array:
        """Signed distances [m], (nx, ny, nz), on a grid: negative inside, correct within 2 steps of the surface."""

    def contains(self, axes: list[Array], index: Array) -> Array:
        """Whether the points of a grid with indices `index`, (M, 3), are inside, (M,) bool."""

    def settle(self, P: Array, depth: float) -> tuple[Array, Array]:
        """Points (N, 3) moved to `depth` [m] below the nearest surface, and outward normals there, (N, 3).

        Where the solid is too thin for this depth, they are moved as deep as possible. A point that finds no surface
        is NaN. An unknown normal is zero.
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
    """Whether the particle is in the outermost layer, (N,) bool."""
    notes: tuple[str, ...] = ()
    """Notes for the user."""


def fill(solid: Solid, spacing: float) -> Filling:
    """Particles, `spacing` [m] apart, that fill a solid; there may be none."""
    axes = lattice(*solid.bounds, spacing)
    d = solid.distance(axes) / spacing
    core = d <= -INTERIOR
    inner, depth = points(axes, np.argwhere(core)), -d[core]
    band = points(axes, np.argwhere(~core & (d < 1 - INTERIOR)))
    outer, normal = _surface(solid, band, inner[depth < INTERIOR + 2], spacing)
    X = np.concatenate([outer, inner])
    surface = np.arange(len(X)) < len(outer)
    depth = np.concatenate([np.full(len(outer), SKIN), depth])
    volume, notes = _volumes(solid, axes, d, X, np.where(surface, 0.0, depth), spacing)
    normal = np.concatenate([normal, np.zeros_like(inner)])
    keep = volume > 0
    return Filling(X[keep], volume[keep], depth[keep] * spacing, normal[keep], surface[keep], notes)


def lattice(lo: Array, hi: Array, spacing: float) -> list[Array]:
    """Coordinates (nx,), (ny,), (nz,) [m] of a lattice centred on the box [lo, hi], (3,) each, three points wider.

    An axis has two centred lattices, with an even and an odd number of points. The one chosen has its outermost inner
    points one spacing below the surface particles of the box's faces, as nearly as possible. Of ties the larger
    number is taken, whatever the digits beyond a thousandth of a spacing.
    """
    spare = np.round((hi - lo) / spacing - 2 * (1 + SKIN) + 1, 3)
    count = np.maximum(np.floor(spare + 0.5), 1) + 6
    return [c + spacing * (np.arange(n) - (n - 1) / 2) for c, n in zip((lo + hi) / 2, count, strict=True)]


def points(axes: list[Array], index: Array) -> Array:
    """Points (M, 3) of the grid of three coordinate arrays with indices (M, 3)."""
    return np.stack([a[i] for a, i in zip(axes, index.T, strict=True)], axis=1)


def slabs(axes: list[Array]) -> list[slice]:
    """Slices of the first axis of a grid, of about a million points each: they bound the memory.

    The grid is given by three coordinate arrays, (nx,), (ny,), (nz,).
    """
    rows = max(1, (1 << 20) // (len(axes[1]) * len(axes[2])))
    return [slice(i, i + rows) for i in range(0, len(axes[0]), rows)]


def _surface(solid: Solid, band: Array, inner: Array, spacing: float) -> tuple[Array, Array]:
    """Surface particles (M, 3) [m] and their normals (M, 3).

    From the lattice points `band` (N, 3) next to the surface. They keep clear of the interior particles `inner` (L, 3).
    """
    P, normal = _settled(solid, band, spacing)
    for _ in range(2 if len(P) else 0):
        for _ in range(3):
            P = P + _repulsion(P, normal, inner, spacing)
        P, normal = _settled(solid, P, spacing)
    keep = _spaced(P, inner, CLOSEST * spacing)
    return P[keep], normal[keep]


def _settled(solid: Solid, P: Array, spacing: float) -> tuple[Array, Array]:
    """The points P (N, 3) moved to the depth SKIN, (M, 3), and the normals there, (M, 3). Failed points are dropped."""
    Q, normal = solid.settle(P, SKIN * spacing)
    settled = np.isfinite(Q).all(axis=1)
    return Q[settled], normal[settled]


def _repulsion(P: Array, normal: Array, inner: Array, spacing: float) -> Array:
    """One step (N, 3) [m] of points P (N, 3) along the surface, away from near neighbours among P and `inner` (L, 3).

    `normal` is (N, 3). A point without a normal has a zero step.
    """
    reach = REPULSION * spacing
    everything = np.concatenate([P, inner])
    i, j = _pairs(everything, reach).T
    i, j = i[i < len(P)], j[i < len(P)]
    offset = everything[i] - everything[j]
    gap = np.maximum(np.linalg.norm(offset, axis=1), 1e-3 * spacing)
    push = offset * (0.3 * (reach - gap) / gap)[:, None]
    sums = [np.bincount(i, p, len(everything)) - np.bincount(j, p, len(everything)) for p in push.T]
    step = np.stack(sums, axis=1)[: len(P)]
    step -= np.einsum("ij,ij->i", step, normal)[:, None] * normal
    step[(normal == 0).all(axis=1)] = 0.0
    return np.clip(step, -0.25 * spacing, 0.25 * spacing)


def _pairs(P: Array, reach: float) -> Array:
    """Pairs i < j, (M, 2), of points (N, 3) nearer than `reach`."""
    found: Array = cKDTree(P).query_pairs(reach, output_type="ndarray")
    return found


def _spaced(P: Array, inner: Array, least: float) -> Array:
    """Whether to keep a point of P (N, 3), (N,) bool: kept points are at least `least` from each other and from `inner`
    (L, 3).
    """
    keep = np.ones(len(P), bool)
    pairs = _pairs(np.concatenate([inner, P]), least) - len(inner)
    for i, j in pairs[np.lexsort(pairs.T)]:
        if j >= 0 and keep[j] and (i < 0 or keep[i]):
            keep[j] = False
    return keep


def _volumes(
    solid: Solid, axes: list[Array], d: Array, X: Array, depth: Array, spacing: float
) -> tuple[Array, tuple[str, ...]]:
    """Volumes [m^3], (N,), of particles X (N, 3), zero for those merged into others, and a note on thin places.

    A cell at least FULL below the surface belongs to its lattice point. Of other cells each sample inside the solid
    belongs to the nearest particle. `d` (nx, ny, nz), the signed distance, and `depth` (N,), 0 on the surface, are in
    spacings.
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
    """The samples of the cells with indices `cells` (M, 3) that are inside the solid, (L, 3) [m].

    `d` (nx, ny, nz) is the signed distance in spacings.
    """
    offsets = spacing * ((np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5)
    fine = [(a[:, None] + offsets).ravel() for a in axes]
    sub = np.stack(np.meshgrid(*[np.arange(SAMPLES)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    index = (SAMPLES * cells[:, None, :] + sub).reshape(-1, 3)
    unsure = np.repeat(d[tuple(cells.T)] > -HALF_DIAGONAL, SAMPLES**3)
    inside = ~unsure
    inside[unsure] = solid.contains(fine, index[unsure])
    return points(fine, index[inside])


def _merged(X: Array, volume: Array) -> Array:
    """Volumes [cells], (N,), of particles X (N, 3): those below SMALLEST are added to the nearest larger particle."""
    tiny = volume < SMALLEST
    if not tiny.any() or tiny.all():
        return volume
    large = np.flatnonzero(~tiny)
    _, to = cKDTree(X[large]).query(X[tiny])
    out: Array = np.where(tiny, 0.0, volume)
    out[large] += np.bincount(to, volume[tiny], len(large))
    return out
