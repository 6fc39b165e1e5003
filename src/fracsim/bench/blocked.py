"""A substep for comparison without SVD and without atomics: blocks of particles, scattered in eight colours.

The same motion as `plain`. Particles are sorted by blocks of 4^3 cells; two blocks of one colour have another block
between them, so that the threads that scatter them never meet at a node. Only nodes near a particle are visited, and
the rotation comes from Newton's iteration. Blocks are laid once: good for motions of less than a cell.
"""

import numpy as np
import taichi as ti

from fracsim.bench import bar
from fracsim.records import Array
from fracsim.scene.vocab import DOMAIN

BLOCK = 4
"""Edge of a block [cells]; a particle reaches two cells further."""
SHARE = 512
"""Taichi splits loops no finer than this: a loop over heavy items is padded by it."""
MU, LAM = bar.material("fixed_corotated").mu, bar.material("fixed_corotated").lam

real33 = ti.types.matrix(3, 3, ti.f32)
Vectors = ti.types.ndarray(dtype=ti.math.vec3, ndim=1)
Matrices = ti.types.ndarray(dtype=real33, ndim=1)
Nodes = ti.types.ndarray(dtype=ti.math.vec4, ndim=1)
Indices = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.func
def stencil(y):
    """Lowest node, offset [cells] and weights of the particle at y [cells]."""
    base = ti.cast(y - 0.5, ti.i32)
    f = y - base
    return base, f, [0.5 * (1.5 - f) ** 2, 0.75 - (f - 1) ** 2, 0.5 * (f - 0.5) ** 2]


@ti.func
def kirchhoff(F):
    """tau = 2 mu (F - R) F^T + lam J (J - 1) I, with R by R <- (R + R^-T) / 2 from F (Higham 1986)."""
    J = F.determinant()
    R = F
    for _ in ti.static(range(4)):
        a = ti.Vector([R[0, 0], R[1, 0], R[2, 0]])
        b = ti.Vector([R[0, 1], R[1, 1], R[2, 1]])
        c = ti.Vector([R[0, 2], R[1, 2], R[2, 2]])
        bc = b.cross(c)
        R = R / 2 + ti.Matrix.cols([bc, c.cross(a), a.cross(b)]) / (2 * a.dot(bc))
    return 2 * MU * (F - R) @ F.transpose() + ti.Matrix.identity(ti.f32, 3) * LAM * J * (J - 1)


@ti.kernel
def clear(live: Indices, nodes: Nodes):
    """Empty the nodes."""
    for q in live:
        nodes[live[q]] = ti.Vector.zero(ti.f32, 4)


@ti.kernel
def scatter(first: ti.i32, end: ti.i32, dt: ti.f32, h: ti.f32, m: ti.f32, volume: ti.f32, sx: ti.i32, sy: ti.i32,
            start: Indices, stop: Indices, x: Vectors, v: Vectors, C: Matrices, F: Matrices, nodes: Nodes):  # fmt: skip
    """What the blocks first .. end - 1, of one colour, send to the nodes."""
    for q in range(first * SHARE, end * SHARE):
        if q % SHARE == 0:
            for p in range(start[q // SHARE], stop[q // SHARE]):
                base, f, w = stencil(x[p] / h)
                damped = C[p] - bar.RPIC / 2 * (C[p] + C[p].transpose())
                affine = m * h * damped - (dt * volume * 4 / h) * kirchhoff(F[p])
                momentum = m * v[p] - affine @ f
                at = base[0] * sx + base[1] * sy + base[2]
                for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                    weight = w[i][0] * w[j][1] * w[k][2]
                    sent = weight * (momentum + affine @ ti.Vector([i, j, k]))
                    r = at + i * sx + j * sy + k
                    nodes[r] = nodes[r] + ti.Vector([sent[0], sent[1], sent[2], weight * m])  # += would be atomic


@ti.kernel
def accelerate(live: Indices, nodes: Nodes):
    """From momentum to velocity; the grid keeps a part of it."""
    for q in live:
        n = nodes[live[q]]
        if n[3] > 0:
            nodes[live[q]] = n * (bar.KEEP / n[3])


@ti.kernel
def gather(dt: ti.f32, h: ti.f32, sx: ti.i32, sy: ti.i32, x: Vectors, v: Vectors, C: Matrices, F: Matrices,
           nodes: Nodes):  # fmt: skip
    """New velocities, positions and deformation of the particles from the nodes."""
    for p in x:
        base, f, w = stencil(x[p] / h)
        at = base[0] * sx + base[1] * sy + base[2]
        new_v, new_C = ti.Vector.zero(ti.f32, 3), ti.Matrix.zero(ti.f32, 3, 3)
        for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
            weighted = w[i][0] * w[j][1] * w[k][2] * nodes[at + i * sx + j * sy + k].xyz
            new_v += weighted
            new_C += weighted.outer_product(ti.Vector([i, j, k]) - f)
        new_C *= 4 / h
        v[p], C[p] = new_v, new_C
        x[p] += dt * new_v
        F[p] += dt * new_C @ F[p]


class Blocked:
    """The particles of a bar, sorted by block, and a box of nodes around them."""

    def __init__(self, X: Array, v: Array, cells: int) -> None:
        self.h = DOMAIN / cells
        cell = np.floor(X / self.h - 0.5).astype(np.int64)
        self.lowest = (cell.min(axis=0) // BLOCK - 1) * BLOCK
        self.order, start, stop, self.bounds = _colour((cell - self.lowest) // BLOCK)
        self.shape = tuple((cell - self.lowest).max(axis=0) + 4)
        self.start, self.stop, self.live = map(_indices, (start, stop, self._near(cell - self.lowest)))
        n = len(X)
        self.x, self.v = (ti.Vector.ndarray(3, ti.f32, n) for _ in range(2))
        self.C, self.F = (ti.Matrix.ndarray(3, 3, ti.f32, n) for _ in range(2))
        self.nodes = ti.Vector.ndarray(4, ti.f32, int(np.prod(self.shape)))
        self.x.from_numpy((X - self.lowest * self.h).astype(np.float32)[self.order])
        self.v.from_numpy(v[self.order])
        self.F.from_numpy(np.tile(np.eye(3, dtype=np.float32), (n, 1, 1)))

    def _near(self, cell: Array) -> Array:
        """Nodes that a particle reaches before it has moved by a cell."""
        near = np.zeros(self.shape, bool)
        for offset in np.ndindex(5, 5, 5):
            near[tuple((cell + offset - 1).T)] = True
        return np.flatnonzero(near)

    def __len__(self) -> int:
        return int(self.x.shape[0])

    def run(self, substeps: int) -> None:
        """Advance by substeps of length DT."""
        volume = (self.h / 2) ** 3
        sx, sy = int(self.shape[1] * self.shape[2]), int(self.shape[2])
        for _ in range(substeps):
            clear(self.live, self.nodes)
            for colour in range(8):
                scatter(self.bounds[colour], self.bounds[colour + 1], bar.DT, self.h, bar.DENSITY * volume, volume,
                        sx, sy, self.start, self.stop, self.x, self.v, self.C, self.F, self.nodes)  # fmt: skip
            accelerate(self.live, self.nodes)
            gather(bar.DT, self.h, sx, sy, self.x, self.v, self.C, self.F, self.nodes)

    def positions(self) -> Array:
        """Present positions [m], (N, 3), in the order given."""
        out = np.empty((len(self.order), 3))
        out[self.order] = self.x.to_numpy() + self.lowest * self.h
        return out


def _colour(block: Array) -> tuple[Array, Array, Array, list[int]]:
    """From each particle's block, (N, 3): the order by block, where each block starts and stops, blocks by colour."""
    size = block.max(axis=0) + 1
    key = np.ravel_multi_index(tuple(block.T), tuple(size))
    order = np.argsort(key, kind="stable")
    used, start, count = np.unique(key[order], return_index=True, return_counts=True)
    colour = np.stack(np.unravel_index(used, tuple(size)), axis=1) % 2 @ (4, 2, 1)
    by_colour = np.argsort(colour, kind="stable")
    bounds = np.searchsorted(colour[by_colour], np.arange(9)).tolist()
    return order, start[by_colour], (start + count)[by_colour], bounds


def _indices(values: Array) -> ti.Ndarray:
    array = ti.ndarray(ti.i32, len(values))
    array.from_numpy(values.astype(np.int32))
    return array
