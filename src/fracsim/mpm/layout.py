"""Where particles and nodes lie in memory: found once (`total`), or again when particles have moved (`updated`)."""

from dataclasses import dataclass

import numpy as np

from fracsim.records import Array

SPARE = 1
"""Planes of nodes around the box: a kernel may round a particle on the face of a cell into the next one, where it finds
one plane more, of no weight."""
BLOCK = 4
"""Particles are sorted by blocks of BLOCK^3 cells, so that neighbours in space are neighbours in memory."""
FACE = 1e-3
"""A particle so near to the face of a cell [cells] lies on it; positions are rounded by 1e-5. Objects are often filled
in steps of half a cell, and who shares a pressure with whom must not depend on round-off."""


def cells(y: Array) -> Array:
    """The cell of each particle at y [cells], (N, 3) int; those on a face, as near as can be told, lie in the next."""
    return np.floor(y - (0.5 - FACE)).astype(np.int64)


def order(y: Array) -> Array:
    """Permutation that sorts particles at y [cells] by block, then by cell, x slowest."""
    cell = cells(y)
    cell -= cell.min(axis=0)
    block, inner = cell // BLOCK, cell % BLOCK
    size = block.max(axis=0) + 1
    key = ((block[:, 0] * size[1] + block[:, 1]) * size[2] + block[:, 2]) * BLOCK**3
    key += (inner[:, 0] * BLOCK + inner[:, 1]) * BLOCK + inner[:, 2]
    return np.argsort(key, kind="stable")


def crowds(y: Array) -> Array:
    """How many particles the cell has whose first one each is, otherwise 0, (N,) int32, for sorted particles at y
    [cells]; what is not sorted makes more cells than there are."""
    cell = cells(y)
    first = np.flatnonzero(np.append(True, (np.diff(cell, axis=0) != 0).any(axis=1)))
    many = np.zeros(len(y), np.int32)
    many[first] = np.diff(np.append(first, len(y)))
    return many


@dataclass(frozen=True)
class Layout:
    """A dense box of nodes around the particles, of which only those near a particle are visited."""

    lowest: Array
    """Index of the box's first node in the infinite grid whose node 0 is the object's centre, (3,) int."""
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

    def positions(self, aside: Array | None = None) -> Array:
        """Positions at rest of the visited nodes [cells from the centre], (M, 3); `aside` as from `apart`."""
        index = np.stack(np.unravel_index(self.nodes, self.shape), axis=1) + self.lowest
        if aside is not None:
            index[:, 0] -= aside[index[:, 0] - self.lowest[0]]
        return index

    def beside(self, which: Array, axis: int, way: Array) -> Array:
        """Which of the visited nodes lies beside each of these along an axis, to the side `way`, -1 or +1, or -1."""
        wanted = self.nodes[which] + way.astype(np.int64) * self.strides[axis]
        at = np.minimum(np.searchsorted(self.nodes, wanted), len(self.nodes) - 1)
        return np.where(self.nodes[at] == wanted, at, -1)

    @property
    def size(self) -> int:
        """Nodes in the box."""
        return self.shape[0] * self.shape[1] * self.shape[2]


def layout(y: Array, chunks: int, margin: int, heads: Array | None = None) -> Layout:
    """The layout for particles at y [cells from the object's centre], valid until one moves by `margin` cells; chunks
    begin with one of the particles `heads`, if these are given."""
    cell = np.floor(y - 0.5).astype(np.int64)
    lowest = cell.min(axis=0) - margin - SPARE
    cell -= lowest
    shape = tuple(int(s) for s in cell.max(axis=0) + 3 + margin + SPARE)
    start = np.linspace(0, len(y), chunks + 1).astype(np.int32)
    if heads is not None:
        start = np.append(heads, len(y))[np.searchsorted(heads, start)].astype(np.int32)
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


def apart(x: Array, label: Array, h: float) -> tuple[Array, Array, Array]:
    """Positions x [m] with the fragments, label >= 0, moved along x by whole cells, until no nodes of two lie side by
    side.

    Also returns by how many cells each fragment has been moved, (fragments,) int, and the fragment of each plane of
    nodes of their layout, (planes,) int. Particles without a fragment (label -1) stay with the first one.
    """
    cell = np.floor(x[:, 0] / h - 0.5).astype(np.int64)
    owner, count = np.maximum(label, 0), int(label.max()) + 1
    low, high = np.full(count, np.iinfo(np.int64).max), np.full(count, np.iinfo(np.int64).min)
    np.minimum.at(low, owner, cell)
    np.maximum.at(high, owner, cell)
    planes = high - low + 3 + SPARE
    first = np.concatenate([[0], np.cumsum(planes)[:-1]]) + low[0]
    moved = first - low
    planes[0] += SPARE
    return _shifted(x, cell + moved[owner], moved[owner], h), moved, np.repeat(np.arange(count), planes)


def _shifted(x: Array, cell: Array, by: Array, h: float) -> Array:
    """Positions moved along x `by` cells, each into its `cell`: what lies on the face of one may be rounded across."""
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
