"""The body that a cloud of Gaussians encloses: opaque cells, small gaps closed, the outside flooded from a corner."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, label
from scipy.spatial import cKDTree

from fracsim.asset.cloud import Gaussians
from fracsim.records import Array

OPAQUE = 0.1
"""Least sum of opacities of an occupied cell."""
WIDEST_GAP = 4
"""Gaps in the shell are closed up to twice this many cells."""
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
    closed = [_closed(occupied, reach) for reach in range(WIDEST_GAP + 1)]
    sizes = np.array([c.sum() for c in closed])
    gaps = int(np.argmax(sizes >= 0.9 * sizes.max()))
    inside = closed[gaps]
    shell = inside & binary_dilation(~inside, NEIGHBOURS)
    # The centres of shell cells are nearest to the outside, one cell away, and on the surface on average.
    depth = distance_transform_edt(inside) - 1.0
    return Body(inside, shell, depth, gaps)


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
