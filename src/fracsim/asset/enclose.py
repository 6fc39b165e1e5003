"""The body that a cloud of Gaussians encloses: opaque cells, small gaps closed, the outside flooded from a corner.

Where a whole side is missing, as the unseen underside of a scan, the flood fills the object. Then rays decide: a
cell is inside if nearly all directions but those of one open side meet the surface.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, label
from scipy.spatial import cKDTree

from fracsim.asset.cloud import Gaussians
from fracsim.records import Array

OPAQUE = 0.1
"""Least sum of opacities of an occupied cell."""
WIDEST_GAP, WIDEST = 4, 0.04
"""Gaps in the shell are closed up to twice this many cells, and up to twice this share of the object's extent."""
TRIES = 5
"""Widths of gaps that are tried, from none to the widest."""
BLOCKED = 17
"""Directions of 26 in which an inner cell meets the surface: all but the nine that point out of one open side."""
HOLLOW = 0.1
"""The flood has failed if it finds less than this share of what rays find beside it."""
NEIGHBOURS = np.ones((3, 3, 3), bool)


@dataclass(frozen=True)
class Body:
    """A solid on a lattice of cells."""

    inside: Array
    """Whether a cell belongs to it, (nx, ny, nz) bool."""
    shell: Array
    """Whether the surface passes through the cell, (nx, ny, nz) bool. Half of such a cell counts as inside."""
    depth: Array
    """Distance below the surface [cells], (nx, ny, nz)."""
    gaps: int
    """Cells by which the shell had to be thickened to be closed."""
    opened: float = 0.0
    """Share of the inside that only rays found: the surface is open there."""
    hollow: float = 0.0
    """Cells that rays find inside and that stayed empty, over those of the body."""

    def volumes(self, X: Array, axes: list[Array], least: float) -> Array:
        """Volumes [cells], (N,), of particles at X (N, 3) [m], on the lattice of three coordinate arrays.

        The particles in a cell share its volume. A cell without particles gives its volume to the nearest particle.
        The volumes are then raised to `least` and scaled to sum to the volume of the body.
        """
        content = np.where(self.shell, 0.5, 1.0) * self.inside
        cell = np.ravel_multi_index(_cells(X, axes), self.inside.shape)
        count = np.bincount(cell, minlength=content.size)
        volume = content.ravel()[cell] / count[cell]
        empty = np.argwhere((content > 0) & (count.reshape(content.shape) == 0))
        if len(empty):
            P = np.stack([a[i] for a, i in zip(axes, empty.T, strict=True)], axis=1)
            _, owner = cKDTree(X).query(P)
            volume += np.bincount(owner, content[tuple(empty.T)], len(X))
        volume = np.maximum(volume, least)
        return np.asarray(volume * (content.sum() / volume.sum()))


def enclose(trained: Gaussians, axes: list[Array], spacing: float) -> Body:
    """The body that Gaussians in the world [m] enclose.

    Its cells are centred on the lattice of three coordinate arrays, (nx,), (ny,) and (nz,), of pitch `spacing` [m].
    """
    occupied = _occupied(trained, axes, spacing)
    extent = float(np.ptp(trained.means, axis=0).max()) / spacing
    widest = max(WIDEST_GAP, round(WIDEST * extent))
    reaches = np.unique(np.linspace(0, widest, TRIES).round().astype(int))
    closed = [_closed(occupied, int(reach)) for reach in reaches]
    sizes = np.array([c.sum() for c in closed])
    chosen = int(np.argmax(sizes >= 0.9 * sizes.max()))
    inside = closed[chosen]
    thick = binary_dilation(occupied, NEIGHBOURS)
    seen = _surrounded(thick) & ~thick & ~inside & _boxed(trained.means, axes)
    opened = hollow = 0.0
    if seen.sum() * HOLLOW > (inside & ~thick).sum():
        chosen, before = 0, closed[0]
        inside = _closed(occupied | seen, 1)
        opened = float((inside & ~before).sum() / inside.sum())
    else:
        hollow = float(seen.sum() / inside.sum())
    shell = inside & binary_dilation(~inside, NEIGHBOURS)
    # The centres of shell cells are nearest to the outside, one cell away, and on the surface on average.
    depth = distance_transform_edt(inside) - 1.0
    return Body(inside, shell, depth, int(reaches[chosen]), opened, hollow)


def _boxed(means: Array, axes: list[Array]) -> Array:
    """Whether the box of points (N, 3) reaches into a cell, (nx, ny, nz) bool."""
    half = (axes[0][1] - axes[0][0]) / 2
    lo, hi = means.min(axis=0) - half, means.max(axis=0) + half
    x, y, z = ((a >= low) & (a <= high) for a, low, high in zip(axes, lo, hi, strict=True))
    out: Array = x[:, None, None] & y[:, None] & z
    return out


def _surrounded(thick: Array) -> Array:
    """Whether at least BLOCKED of the 26 directions to neighbours meet an occupied cell, (nx, ny, nz) bool.

    The occupied cells are thickened by one, `thick`, (nx, ny, nz) bool, so that no ray slips through between two.
    """
    count = np.zeros(thick.shape, np.int8)
    for way in np.argwhere(np.ones((3, 3, 3))) - 1:
        if way.any():
            count += _met(thick, way)
    return np.asarray(count >= BLOCKED)


def _met(thick: Array, way: Array) -> Array:
    """Whether the ray from a cell in a direction, (3,) of -1, 0, 1, meets a cell of `thick`, (nx, ny, nz) bool.

    By doubling: after k rounds it has looked 2^k cells far.
    """
    met: Array = thick.copy()
    step = 1
    while step < max(thick.shape):
        here = tuple(slice(None) if w == 0 else slice(None, -step) if w > 0 else slice(step, None) for w in way)
        there = tuple(slice(None) if w == 0 else slice(step, None) if w > 0 else slice(None, -step) for w in way)
        before = met.copy()
        met[here] |= before[there]
        step *= 2
    return met


def _occupied(trained: Gaussians, axes: list[Array], spacing: float) -> Array:
    """Whether the opacities in a cell sum to OPAQUE, (nx, ny, nz) bool.

    A wide Gaussian counts in all cells of the disc of its two longer axes.
    """
    density = np.zeros([len(a) for a in axes])
    variances, vectors = np.linalg.eigh(trained.covariance)
    wide = np.sqrt(variances[:, 2]) > 0.5 * spacing
    np.add.at(density, _cells(trained.means, axes), trained.opacity)
    for radius, count in ((0.5, 6), (1.0, 12)):
        for angle in 2 * np.pi * np.arange(count) / count:
            shift = radius * np.sqrt(variances[wide]) * np.array([0.0, np.cos(angle), np.sin(angle)])
            P = trained.means[wide] + np.einsum("nij,nj->ni", vectors[wide], shift)
            np.add.at(density, _cells(P, axes), trained.opacity[wide])
    return density >= OPAQUE


def _cells(X: Array, axes: list[Array]) -> tuple[Array, ...]:
    """Three index arrays, (N,) each, of the cells that contain points (N, 3)."""
    step = axes[0][1] - axes[0][0]
    near = ((np.rint((x - a[0]) / step).astype(int), len(a)) for x, a in zip(X.T, axes, strict=True))
    return tuple(np.clip(index, 0, n - 1) for index, n in near)


def _closed(occupied: Array, reach: int) -> Array:
    """The occupied cells and those that they enclose, once gaps of up to 2 `reach` cells are closed, (nx, ny, nz) bool.

    `occupied`, (nx, ny, nz) bool, is thickened by `reach` cells, filled, and thinned again.
    """
    room = np.pad(occupied, reach + 1)
    thick = distance_transform_edt(~room) <= reach
    parts, _ = label(~thick)
    filled = parts != parts[0, 0, 0]
    thin = distance_transform_edt(filled) > reach
    core = slice(reach + 1, -reach - 1)
    return np.asarray((thin | room)[core, core, core])
