"""Depth order, and for each tile the list of Gaussians that meet it, nearest first.

The depth order is cut into CHUNKS consecutive parts. A first pass counts the entries that each chunk adds to each tile,
a second writes them to the place that the counts give. So there are no atomics, and the lists are the same on every
backend and with any number of threads.
"""

import numpy as np
import taichi as ti

from fracsim.records import Array

CHUNKS = 64
"""Parts of the depth order that are processed in parallel."""
PAD = 512
"""Taichi runs up to this many consecutive iterations of a CPU loop on one thread. Loops over chunks are padded to PAD
iterations a chunk, so that each chunk can have its own thread."""


def depth_order(depth: Array) -> Array:
    """Indices, (N,) int32, that sort non-negative depths, (N,), ascending and stably.

    A radix sort: non-negative floats have the order of their bits, and NumPy sorts 16-bit digits in linear time.
    """
    digits = depth.view("<u2").reshape(len(depth), -1)
    order = np.argsort(digits[:, 0], kind="stable")
    for digit in digits.T[1:]:
        order = order[np.argsort(digit[order], kind="stable")]
    return order.astype(np.int32)


@ti.kernel
def count(
    order: ti.types.ndarray(dtype=ti.i32, ndim=1),  # Gaussians, nearest first, (N,)
    rectangle: ti.types.ndarray(dtype=ti.types.vector(4, ti.i32), ndim=1),  # first x, y, end x, y [tiles], (N,)
    table: ti.types.ndarray(dtype=ti.i32, ndim=3),  # out: entries of a tile from a chunk, (CHUNKS, tiles_y, tiles_x)
):
    """Count the entries that each chunk of the depth order adds to each tile."""
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
    order: ti.types.ndarray(dtype=ti.i32, ndim=1),  # Gaussians, nearest first, (N,)
    rectangle: ti.types.ndarray(dtype=ti.types.vector(4, ti.i32), ndim=1),  # first x, y, end x, y [tiles], (N,)
    table: ti.types.ndarray(dtype=ti.i32, ndim=3),  # place of a chunk's next entry, (CHUNKS, tiles_y, tiles_x)
    entries: ti.types.ndarray(dtype=ti.i32, ndim=1),  # out: Gaussians of tile 0, of tile 1, ..., (entries,)
):
    """Write each tile's Gaussians, nearest first. Afterwards `table` holds the end of each chunk's entries."""
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
    """First item of chunk c of n items."""
    return ti.min(c * ((n + CHUNKS - 1) // CHUNKS), n)


def starts(table: Array) -> tuple[Array, Array]:
    """Places of first entries, from the counts `table`, (CHUNKS, tiles_y, tiles_x).

    Returns those of each chunk in each tile, (CHUNKS, tiles_y, tiles_x) int32, and those of each tile, (tiles + 1,)
    int32. Raises ValueError for more entries than an int32 can number.
    """
    counts = table.reshape(CHUNKS, -1).T
    ends = np.cumsum(counts, dtype=np.int64).reshape(counts.shape)
    total = int(ends[-1, -1])
    if total > np.iinfo(np.int32).max:
        raise ValueError(f"camera: the Gaussians meet {total} tiles in all, over 2^31: lower camera.width and "
                         "camera.height, or solver.cells.")  # fmt: skip
    tile_starts = np.append(0, ends[:, -1])
    chunk_starts = (ends - counts).T.reshape(table.shape)
    return chunk_starts.astype(np.int32, order="C"), tile_starts.astype(np.int32)
