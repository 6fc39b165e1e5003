"""Where particles and nodes lie in memory: found once (`total`), or again when particles have moved (`updated`)."""

from dataclasses import dataclass

import numpy as np

from fracsim.records import Array

SPARE = 1
"""Spare planes of nodes around the box. A kernel may round a particle on the face of a cell into the next cell: it then
touches one plane more, with zero weight."""
BLOCK = 4
"""Particles are sorted by blocks of BLOCK^3 cells, so that neighbours in space are neighbours in memory."""
FACE = 1e-3
"""A particle this near to the face of a cell [cells] lies on it; positions are rounded by 1e-5. Many objects are filled
in steps of half a cell, and the grouping into cells, which share a pressure, must not depend on round-off."""


def cells(y: Array) -> Array:
    """Cells of particles at y [cells], (N, 3) -> (N, 3) int; a particle within FACE of a face lies in the next one."""
    return np.floor(y - (0.5 - FACE)).astype(np.int64)


def order(y: Array) -> Array:
    """Permutation, (N,), that sorts particles at y [cells], (N, 3), by block, then by cell, x slowest."""
    cell = cells(y)
    cell -= cell.min(axis=0)
    block, inner = cell // BLOCK, cell % BLOCK
    size = block.max(axis=0) + 1
    key = ((block[:, 0] * size[1] + block[:, 1]) * size[2] + block[:, 2]) * BLOCK**3
    key += (inner[:, 0] * BLOCK + inner[:, 1]) * BLOCK + inner[:, 2]
    return np.argsort(key, kind="stable")


def cell_counts(y: Array) -> Array:
    """Particles per cell, stored at the cell's first particle, 0 elsewhere, (N,) int32.

    Positions y [cells], (N, 3), must be sorted by cell.
    """
    cell = cells(y)
    first = np.flatnonzero(np.append(True, (np.diff(cell, axis=0) != 0).any(axis=1)))
    counts = np.zeros(len(y), np.int32)
    counts[first] = np.diff(np.append(first, len(y)))
    return counts


@dataclass(frozen=True)
class Layout:
    """A dense box of nodes around the particles; only nodes near a particle are visited."""

    lowest: Array
    """Index of the box's first node in an infinite grid that has node 0 at the object's centre, (3,) int."""
    shape: tuple[int, int, int]
    """Nodes along each axis."""
    start: Array
    """Particles of chunk c are start[c] .. start[c + 1], (chunks + 1,) int32."""
    nodes: Array
    """Index in the box of each node near a particle, (M,) int32."""
    source: Array
    """Index of each such node in each chunk's copy, or -1, (M, chunks) int32."""
    shift: Array
    """Add to an index in the box to get the index in a chunk's copy, (chunks,) int32."""
    copies: int
    """Nodes in all copies together."""

    @property
    def strides(self) -> tuple[int, int, int]:
        """Strides of the three axes."""
        return self.shape[1] * self.shape[2], self.shape[2], 1

    def positions(self, plane_offset: Array | None = None) -> Array:
        """Positions at rest of the visited nodes [cells from the centre], (M, 3).

        `plane_offset` [cells], (planes,), says how far `separate_fragments` has moved each plane of nodes along x.
        """
        index = np.stack(np.unravel_index(self.nodes, self.shape), axis=1) + self.lowest
        if plane_offset is not None:
            index[:, 0] -= plane_offset[index[:, 0] - self.lowest[0]]
        return index

    def neighbour(self, nodes: Array, axis: int, direction: Array) -> Array:
        """The visited node next to each of `nodes` along an axis, in `direction` -1 or +1; else -1, (n,)."""
        wanted = self.nodes[nodes] + direction.astype(np.int64) * self.strides[axis]
        at = np.minimum(np.searchsorted(self.nodes, wanted), len(self.nodes) - 1)
        return np.where(self.nodes[at] == wanted, at, -1)

    @property
    def size(self) -> int:
        """Nodes in the box."""
        return self.shape[0] * self.shape[1] * self.shape[2]


def layout(y: Array, chunks: int, margin: int, cell_starts: Array | None = None) -> Layout:
    """The layout for particles at y [cells from the object's centre], (N, 3).

    It is valid until a particle moves by `margin` cells. Each chunk begins with one of the particles `cell_starts`, if
    these are given.
    """
    cell = np.floor(y - 0.5).astype(np.int64)
    lowest = cell.min(axis=0) - margin - SPARE
    cell -= lowest
    shape = tuple(int(s) for s in cell.max(axis=0) + 3 + margin + SPARE)
    start = np.linspace(0, len(y), chunks + 1).astype(np.int32)
    if cell_starts is not None:
        start = np.append(cell_starts, len(y))[np.searchsorted(cell_starts, start)].astype(np.int32)
    nodes = np.flatnonzero(_near(cell, shape, margin))
    sx = shape[1] * shape[2]
    plane = nodes // sx
    source = np.full((len(nodes), chunks), -1, np.int32)
    shift, total = np.zeros(chunks, np.int32), 0
    for c in range(chunks):
        x = cell[start[c] : start[c + 1], 0]
        if not len(x):
            continue
        first, last = int(x.min()) - margin - SPARE, int(x.max()) + 3 + margin + SPARE
        shift[c] = total - first * sx
        mine = (plane >= first) & (plane < last)
        source[mine, c] = nodes[mine] + shift[c]
        total += (last - first) * sx
    return Layout(lowest, shape, start, nodes.astype(np.int32), source, shift, total)  # type: ignore[arg-type]


def separate_fragments(x: Array, fragment: Array, h: float) -> tuple[Array, Array, Array]:
    """Move fragments along x by whole cells until no two of them share a plane of nodes.

    x [m], (N, 3), are positions, `fragment`, (N,) int, the fragment of each particle; particles without one (-1) move
    with fragment 0. Returns the new positions, the offset of each fragment [cells], (fragments,) int, and the fragment
    of each plane of nodes in the new layout, (planes,) int.
    """
    cell = np.floor(x[:, 0] / h - 0.5).astype(np.int64)
    owner, count = np.maximum(fragment, 0), int(fragment.max()) + 1
    low, high = np.full(count, np.iinfo(np.int64).max), np.full(count, np.iinfo(np.int64).min)
    np.minimum.at(low, owner, cell)
    np.maximum.at(high, owner, cell)
    planes = high - low + 3 + SPARE
    first = np.concatenate([[0], np.cumsum(planes)[:-1]]) + low[0]
    offset = first - low
    planes[0] += SPARE
    return _shifted(x, cell + offset[owner], offset[owner], h), offset, np.repeat(np.arange(count), planes)


def _shifted(x: Array, cell: Array, by: Array, h: float) -> Array:
    """Positions moved along x `by` cells, each into its `cell`: rounding may carry a particle on a face across it."""
    out: Array = x.copy()
    out[:, 0] += (by * h).astype(x.dtype)
    for _ in range(8):
        wrong = np.sign(cell - np.floor(out[:, 0] / h - 0.5))
        if not wrong.any():
            break
        out[:, 0] = np.where(wrong == 0, out[:, 0], np.nextafter(out[:, 0], (wrong * 9e9).astype(x.dtype)))
    return out


def _near(cell: Array, shape: tuple[int, ...], margin: int) -> Array:
    """Mask of the nodes that a particle in one of the cells, or up to `margin` cells away, touches."""
    occupied = np.zeros(shape, bool)
    occupied[tuple(cell.T)] = True
    for axis in range(3):
        grown = occupied.copy()
        for k in range(-margin, 3 + margin):
            if k:
                to = [slice(None)] * 3
                at = [slice(None)] * 3
                to[axis] = slice(max(k, 0), shape[axis] + min(k, 0))
                at[axis] = slice(max(-k, 0), shape[axis] - max(k, 0))
                grown[tuple(to)] |= occupied[tuple(at)]
        occupied = grown
    return occupied
