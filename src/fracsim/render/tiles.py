"""Depth order, and for each tile the list of Gaussians that meet it, nearest first.

Gaussians are walked in depth order, in CHUNKS consecutive parts that know where each of their entries of each tile
goes: no atomics, the same lists on every backend and with any number of threads.
"""

import numpy as np
import taichi as ti

from fracsim.records import Array

CHUNKS = 64
"""Parts of the depth order that are walked in parallel."""
PAD = 512
"""Taichi runs up to this many iterations of a CPU loop on one thread, so a heavy item is given that many."""


def depth_order(depth: Array) -> Array:
    """Indices, (N,) int32, that sort non-negative depths ascending, equal ones in their order.

    A radix sort: bits of non-negative floats order as they do, and NumPy sorts 16-bit digits in linear time.
    """
    digits = depth.view("<u2").reshape(len(depth), -1)
    order = np.argsort(digits[:, 0], kind="stable")
    for digit in digits.T[1:]:
        order = order[np.argsort(digit[order], kind="stable")]
    return order.astype(np.int32)


@ti.kernel
def count(
    order: ti.types.ndarray(dtype=ti.i32, ndim=1),  # [N] nearest first
    rectangle: ti.types.ndarray(dtype=ti.types.vector(4, ti.i32), ndim=1),  # [N] first x, y, end x, y
    table: ti.types.ndarray(dtype=ti.i32, ndim=3),  # [CHUNKS, tiles_y, tiles_x] out: entries of a tile from a chunk
):
    """Count the Gaussians that each chunk of the depth order adds to each tile."""
    for q in range(CHUNKS * PAD):
        if q % PAD == 0:
            c = q // PAD
            for y, x in ti.ndrange(table.shape[1], table.shape[2]):
                table[c, y, x] = 0
            for r in range(part(c, order.shape[0]), part(c + 1, order.shape[0])):
                box = rectangle[order[r]]
                for y in range(box[1], box[3]):
                    for x in range(box[0], box[2]):
                        table[c, y, x] = table[c, y, x] + 1  # += would be atomic


@ti.kernel
def fill(
    order: ti.types.ndarray(dtype=ti.i32, ndim=1),  # [N] nearest first
    rectangle: ti.types.ndarray(dtype=ti.types.vector(4, ti.i32), ndim=1),  # [N]
    table: ti.types.ndarray(dtype=ti.i32, ndim=3),  # [CHUNKS, tiles_y, tiles_x] where a chunk's next entry goes
    entries: ti.types.ndarray(dtype=ti.i32, ndim=1),  # [P] out: Gaussians of tile 0, of tile 1, ...
):
    """Write each tile's Gaussians, nearest first; afterwards the table holds where each chunk's entries end."""
    for q in range(CHUNKS * PAD):
        if q % PAD == 0:
            c = q // PAD
            for r in range(part(c, order.shape[0]), part(c + 1, order.shape[0])):
                box = rectangle[order[r]]
                for y in range(box[1], box[3]):
                    for x in range(box[0], box[2]):
                        place = table[c, y, x]
                        entries[place] = order[r]
                        table[c, y, x] = place + 1


@ti.func
def part(c, n):
    """Where chunk c of n items starts."""
    return ti.min(c * ((n + CHUNKS - 1) // CHUNKS), n)


def starts(table: Array) -> tuple[Array, Array]:
    """From counts (CHUNKS, tiles_y, tiles_x): where each chunk's entries start, and each tile's, (tiles + 1,).

    Raises ValueError when there are more entries than an int32 can number.
    """
    counts = table.reshape(CHUNKS, -1).T
    ends = np.cumsum(counts, dtype=np.int64).reshape(counts.shape)
    total = int(ends[-1, -1])
    if total > np.iinfo(np.int32).max:
        raise ValueError(f"camera: the Gaussians meet {total} tiles in all, over 2^31: a smaller picture, or fewer "
                         "or smaller Gaussians.")  # fmt: skip
    tile_starts = np.append(0, ends[:, -1])
    chunk_starts = (ends - counts).T.reshape(table.shape)
    return chunk_starts.astype(np.int32, order="C"), tile_starts.astype(np.int32)
