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
FOOT = 0.12
"""Part of the outline's height within which its lower edge is that of a flat base."""
RIM = 1.5
"""Nearer to the outline than this, u is its distance times the slope farther in [grid points]."""
NEAR = 0.05
"""Least distance of the outline that counts [grid points]."""


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
    wall: Array | None = None
    """Distance from the outline, positive inside, (rows, columns), which cuts the body; None where u is 0 on it."""

    def __call__(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """u and its derivatives along x and y at points (N,), (N,) each, interpolated linearly."""
        u, ux, uy = (self._at(a, x, y) for a in (self.u, *self.slope))
        return u, ux, uy

    def beyond(self, x: Array, y: Array) -> Array:
        """How far points (N,), (N,) are outside the outline, (N,), where that cuts the body; -inf elsewhere."""
        return np.full(x.shape, -np.inf) if self.wall is None else -self._at(self.wall, x, y)

    def _at(self, values: Array, x: Array, y: Array) -> Array:
        """Values of the grid at points, (N,)."""
        at = np.stack([(y - self.origin[1]) / self.step, (x - self.origin[0]) / self.step])
        out: Array = map_coordinates(values, at, order=1, mode="nearest")
        return out

    @property
    def top(self) -> float:
        """The largest h."""
        return float(np.sqrt(self.u.max()))


def inflate(mask: Array, depth: float, *, flat_back: bool = False, flat_base: bool = False) -> Relief:
    """The relief of an outline, (H, W) bool, cut to its box.

    The body's thickness, 2 h, or h with a flat back, is at most `depth` times the smaller side of the box. With a flat
    base the body does not close below, where the outline is within FOOT of its lowest point: it is that of the outline
    and its mirror image below, cut by the outline.
    """
    scale = ACROSS / max(mask.shape)
    distance = _signed(_with_foot(mask) if flat_base else mask, scale)
    inside = distance > 0
    u = np.zeros(distance.shape)
    u[inside] = _membrane(distance)
    deep = distance > RIM
    ratio = np.where(deep, u / np.where(deep, distance, 1), 0)
    nearest = distance_transform_edt(~deep, return_distances=False, return_indices=True)
    u = np.where(deep, u, distance * gaussian_filter(ratio[tuple(nearest)], 1.0))
    width, height = np.array(mask.shape[::-1]) / max(mask.shape)
    u *= (depth * min(width, height) / (1 if flat_back else 2)) ** 2 / u.max()
    step, wall = 1 / ACROSS, None
    if flat_base:
        wall = (step * _signed(mask, scale)).astype(np.float32)
        u = u[len(u) - len(wall) :]
    uy, ux = np.gradient(u, step)
    origin = tuple(-size / 2 - (PAD - 0.5) * step for size in (width, height))
    values, *slope = (a.astype(np.float32) for a in (u, ux, uy))
    return Relief(values, (slope[0], slope[1]), (origin[0], origin[1]), step, wall)


def _with_foot(mask: Array) -> Array:
    """An outline, (H, W) bool, that goes down to its lowest point where it nearly does, on its mirror image."""
    height = len(mask)
    lowest = height - 1 - np.argmax(np.flipud(mask), axis=0)
    below = np.arange(height)[:, None] > lowest
    foot = mask | (below & mask.any(axis=0) & (height - 1 - lowest < FOOT * height))
    return np.concatenate([foot, np.flipud(foot)])


def _signed(mask: Array, scale: float) -> Array:
    """Distance from the outline of `mask`, (H, W) bool, positive inside, in grid points, (rows from below, columns).

    `scale` is the number of grid points a pixel.
    """
    height, width = mask.shape
    columns, rows = (max(2, round(n * scale)) for n in (width, height))
    picture = Image.fromarray(mask.astype(np.float32)).resize((FINE * columns, FINE * rows), Image.Resampling.BOX)
    fine = np.flipud(np.asarray(picture) > 0.5)
    fine = np.pad(fine, FINE * PAD)
    signed = np.where(fine, distance_transform_edt(fine) - 0.5, 0.5 - distance_transform_edt(~fine))
    smooth = gaussian_filter(signed, FINE / 2)
    coarse = smooth.reshape(len(fine) // FINE, FINE, -1, FINE).mean(axis=(1, 3)) / FINE
    out: Array = coarse
    return out


def _membrane(distance: Array) -> Array:
    """u of the membrane where `distance` [steps], (rows, columns), is positive, one value each, in squares of a step.

    Where a neighbour is outside, u is 0 at the outline between them (Gibou et al. 2002): second order, whatever the
    grid.
    """
    inside = distance > 0
    count = int(inside.sum())
    number = np.full(inside.shape, -1)
    number[inside] = np.arange(count)
    r, c = np.nonzero(inside)
    diagonal, rows, columns = np.zeros(count), [np.arange(count)], [np.arange(count)]
    for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        other, beyond = number[r + dr, c + dc], distance[r + dr, c + dc]
        near = distance[r, c] / np.maximum(distance[r, c] - beyond, 1e-9)
        diagonal += np.where(other >= 0, 1, 1 / np.clip(near, NEAR, 1))
        rows.append(number[r, c][other >= 0])
        columns.append(other[other >= 0])
    values = np.concatenate([diagonal, *(np.full(len(k), -1.0) for k in rows[1:])])
    matrix = csc_matrix(coo_matrix((values, (np.concatenate(rows), np.concatenate(columns)))))
    out: Array = splu(matrix).solve(np.full(count, 4.0))
    return out
