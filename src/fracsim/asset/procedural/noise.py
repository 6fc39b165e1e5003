"""Seeded procedural noise on points: value noise, its fractal sum, and jittered cells; no global random state."""

import functools

import numpy as np
from numpy.typing import NDArray

from fracsim.asset.procedural.shapes import Array

PERIOD = 64  # lattice points along an axis before the noise repeats: a table of 1 MiB stays in the cache
# A fixed rotation, so that no lattice plane is parallel to a coordinate plane.
ROTATION = np.array([[0.36, 0.48, -0.80], [-0.80, 0.60, 0.0], [0.48, 0.64, 0.60]], dtype=np.float32)


@functools.cache
def _table(seed: int) -> NDArray[np.float32]:
    """Uniform numbers in [0, 1), (PERIOD^3,), of one seed."""
    return np.random.Generator(np.random.PCG64(seed)).random(PERIOD**3, dtype=np.float32)


def _lattice(P: Array, frequency: float, seed: int) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """Lattice coordinates of points (3, N): the fraction (3, N) and the integer part (3, N)."""
    turn, x, y, z = ROTATION * np.float32(frequency), *P.astype(np.float32, copy=False)
    # Written out: the matrix product costs three times as much on so few rows.
    Q = np.stack([r[0] * x + r[1] * y + r[2] * z for r in turn]) + np.float32(0.37 * (seed % 61))
    base = np.floor(Q)
    return Q - base, base.astype(np.intp)


def _corner_strides(base: NDArray[np.intp]) -> list[list[NDArray[np.intp]]]:
    """Offsets (N,) in the flat table of the two lattice planes around each point, for each of three axes.

    `base`, (3, N), is the integer part of the lattice coordinates.
    """
    mask = PERIOD - 1
    return [[((base[a] + s) & mask) * PERIOD**a for s in (0, 1)] for a in range(3)]


def _entries(table: NDArray[np.float32], at: NDArray[np.intp]) -> NDArray[np.float32]:
    """Entries (N,) of the table (PERIOD^3,) at indices (N,)."""
    # `clip` spares NumPy a check: the mask of `_corner_strides` keeps indices in range.
    out: NDArray[np.float32] = table.take(at, mode="clip")
    return out


def value(P: Array, frequency: float, seed: int) -> NDArray[np.float32]:
    """Value noise in [-1, 1], (N,), of points (3, N); `frequency` lattice cells a unit, C^1 (Perlin 1985's fade)."""
    f, base = _lattice(P, frequency, seed)
    table, (xs, ys, zs) = _table(seed), _corner_strides(base)
    w = f * f * (3 - 2 * f)
    planes = []
    for z in zs:
        rows = []
        for y in ys:
            left, right = _entries(table, xs[0] + (y + z)), _entries(table, xs[1] + (y + z))
            rows.append(left + w[0] * (right - left))
        planes.append(rows[0] + w[1] * (rows[1] - rows[0]))
    mixed: NDArray[np.float32] = planes[0] + w[2] * (planes[1] - planes[0])
    return 2 * mixed - 1


def fractal(P: Array, frequency: float, seed: int, octaves: int = 3) -> NDArray[np.float32]:
    """Sum of octaves of value noise, each twice as fine and half as strong, about [-1, 1], (N,) of points (3, N)."""
    total = value(P, frequency, seed)
    for k in range(1, octaves):
        total = total + value(P, frequency * 2**k, seed + k) * np.float32(0.5**k)
    scaled: NDArray[np.float32] = total * np.float32(1 / (2 - 0.5 ** (octaves - 1)))
    return scaled


def cells(P: Array, frequency: float, seed: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Of points (3, N): distance (N,) to the nearest jittered lattice point, in lattice cells, and a random number (N,)
    in [0, 1) of that point.

    Searches the eight nearest cells only (Worley 1996 searches 27): exact where the distance is below 0.5.
    """
    f, base = _lattice(P, frequency, seed)
    low = np.where(f < 0.5, -1, 0)
    f, strides = f - low.astype(np.float32), _corner_strides(base + low)
    jitter = [_table(seed + 1000 * (a + 1)) for a in range(3)]
    best, own = np.full(P.shape[1], 9.0, np.float32), np.zeros(P.shape[1], np.intp)
    for corner in np.ndindex(2, 2, 2):
        at = strides[0][corner[0]] + strides[1][corner[1]] + strides[2][corner[2]]
        d = sum(np.square(f[a] - corner[a] - _entries(jitter[a], at)) for a in range(3))
        nearer = d < best
        best, own = np.where(nearer, d, best), np.where(nearer, at, own)
    return np.sqrt(best), _entries(_table(seed), own)
