"""A body from an outline: its half thickness h over the plane, from the equation of a membrane under pressure.

u = h^2 solves laplace(u) = -4 inside the outline and u = 0 on it. So a disc becomes a ball exactly, a strip a cylinder,
and parts are as thick as they are wide; unlike a distance from the outline, u has no crease along the middle. Then h is
scaled to the wanted depth. All lengths are in largest extents of the outline, x right and y up from its box's centre.
"""

from dataclasses import dataclass

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import splu

from fracsim.records import Array

ACROSS = 160
"""Grid points along the extent."""
FINE = 4
"""Pixels of the outline a grid point: its distance is that finely resolved."""
PAD = 12
"""Grid points around the outline."""
RIM = 1.5
"""Nearer to the outline than this, u is its distance times the slope farther in [grid points]."""


@dataclass(frozen=True, eq=False)
class Relief:
    """u on a grid of the plane: positive inside the outline, negative outside."""

    u: Array
    """(rows, columns), rows from below."""
    slope: tuple[Array, Array]
    """Its derivatives along x and y, (rows, columns) each."""
    origin: tuple[float, float]
    """x and y of the first grid point."""
    step: float
    foot: float
    """y below which nothing is; -inf without a flat base."""

    def __call__(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """u and its derivatives along x and y at points (N,), (N,) each, interpolated linearly."""
        at = np.stack([(y - self.origin[1]) / self.step, (x - self.origin[0]) / self.step])
        u, ux, uy = (map_coordinates(a, at, order=1, mode="nearest") for a in (self.u, *self.slope))
        return u, ux, uy

    @property
    def top(self) -> float:
        """The largest h."""
        return float(np.sqrt(self.u.max()))


def inflate(mask: Array, depth: float, *, flat_back: bool = False, flat_base: bool = False) -> Relief:
    """The relief of an outline, (H, W) bool, cut to its box.

    The body's thickness, 2 h, or h with a flat back, is at most `depth` times the smaller side of the box. A flat base
    is a plane through the lowest point, on which the outline is mirrored, so that it does not close there.
    """
    distance = _signed(mask, flat_base)
    inside = distance > 0
    u = np.zeros(distance.shape)
    u[inside] = _membrane(inside)
    deep = distance > RIM
    ratio = np.where(deep, u / np.where(deep, distance, 1), 0)
    nearest = distance_transform_edt(~deep, return_distances=False, return_indices=True)
    u = np.where(deep, u, distance * gaussian_filter(ratio[tuple(nearest)], 1.0))
    width, height = np.array(mask.shape[::-1]) / max(mask.shape)
    u *= (depth * min(width, height) / (1 if flat_back else 2)) ** 2 / u.max()
    if flat_base:  # the upper half of the mirrored outline, and as much below as the pad is wide
        u = u[len(u) // 2 - PAD :]
    step = 1 / ACROSS
    uy, ux = np.gradient(u, step)
    origin = tuple(-size / 2 - (PAD - 0.5) * step for size in (width, height))
    values, *slope = (a.astype(np.float32) for a in (u, ux, uy))
    return Relief(values, (slope[0], slope[1]), (origin[0], origin[1]), step, -height / 2 if flat_base else -np.inf)


def _signed(mask: Array, mirrored: bool) -> Array:
    """Distance from the outline of `mask`, (H, W) bool, positive inside, in grid points, (rows from below, columns)."""
    height, width = mask.shape
    scale = ACROSS / max(height, width)
    columns, rows = (max(2, round(n * scale)) for n in (width, height))
    picture = Image.fromarray(mask.astype(np.float32)).resize((FINE * columns, FINE * rows), Image.Resampling.BOX)
    fine = np.flipud(np.asarray(picture) > 0.5)
    if mirrored:
        fine = np.concatenate([np.flipud(fine), fine])
    fine = np.pad(fine, FINE * PAD)
    signed = np.where(fine, distance_transform_edt(fine) - 0.5, 0.5 - distance_transform_edt(~fine))
    smooth = gaussian_filter(signed, FINE / 2)
    coarse = smooth.reshape(len(fine) // FINE, FINE, -1, FINE).mean(axis=(1, 3)) / FINE
    out: Array = coarse
    return out


def _membrane(inside: Array) -> Array:
    """u of the membrane at the grid points `inside`, (rows, columns) bool, one value each, in squares of a step."""
    number = np.full(inside.shape, -1)
    count = int(inside.sum())
    number[inside] = np.arange(count)
    r, c = np.nonzero(inside)
    rows, columns = [np.arange(count)], [np.arange(count)]
    for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        other = number[r + dr, c + dc]
        rows.append(number[r, c][other >= 0])
        columns.append(other[other >= 0])
    values = np.concatenate([np.full(count, 4.0), *(np.full(len(k), -1.0) for k in rows[1:])])
    matrix = csc_matrix(coo_matrix((values, (np.concatenate(rows), np.concatenate(columns)))))
    out: Array = splu(matrix).solve(np.full(count, 4.0))
    return out
