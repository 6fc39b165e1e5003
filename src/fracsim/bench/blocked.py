"""A substep for comparison, without SVD and without atomics: blocks of particles, scattered in eight colours.

It computes the same motion as `plain`. Particles are sorted by blocks of 4^3 cells. Blocks of one colour are separated
by other blocks, so that the threads that scatter them never share a node. Only nodes near a particle are visited. The
rotation comes from Newton's iteration. Blocks are chosen once, so that motions must stay below a cell.
"""

import numpy as np
import taichi as ti

from fracsim.bench import bar
from fracsim.records import Array
from fracsim.scene.vocab import DOMAIN

BLOCK = 4
"""Edge of a block [cells]; particles scatter up to two cells beyond."""
PAD = 512
"""Taichi runs up to this many consecutive iterations on one thread. A loop over blocks is padded to PAD iterations a
block, so that each block can have its own thread."""
MU, LAM = bar.material("fixed_corotated").mu, bar.material("fixed_corotated").lam

real33 = ti.types.matrix(3, 3, ti.f32)
Vectors = ti.types.ndarray(dtype=ti.math.vec3, ndim=1)
Matrices = ti.types.ndarray(dtype=real33, ndim=1)
Nodes = ti.types.ndarray(dtype=ti.math.vec4, ndim=1)
Indices = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.func
def stencil(y):
    """Lowest node, offset from it [cells] and weights along each axis, (3,) each, of a particle at y [cells], (3,)."""
    base = ti.cast(y - 0.5, ti.i32)
    f = y - base
    return base, f, [0.5 * (1.5 - f) ** 2, 0.75 - (f - 1) ** 2, 0.5 * (f - 0.5) ** 2]


@ti.func
def kirchhoff(F):
    """tau = 2 mu (F - R) F^T + lam J (J - 1) I [Pa]; R <- (R + R^-T) / 2, from R = F (Higham 1986)."""
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
def clear(
    live: Indices,  # nodes near a particle, (L,)
    nodes: Nodes,  # (nodes,)
):
    """Set the nodes near particles to zero."""
    for q in live:
        nodes[live[q]] = ti.Vector.zero(ti.f32, 4)


@ti.kernel
def scatter(
    first: ti.i32, end: ti.i32,  # blocks first, ..., end - 1 of one colour
    dt: ti.f32, h: ti.f32,  # [s], [m]
    m: ti.f32, volume: ti.f32,  # of a particle [kg], [m^3]
    sx: ti.i32, sy: ti.i32,  # nodes from one to the next along x, along y
    start: Indices, stop: Indices,  # first particle and end of each block, (blocks,)
    x: Vectors, v: Vectors,  # [m], [m/s], (N,)
    C: Matrices, F: Matrices,  # [1/s], [1], (N,)
    nodes: Nodes,  # out: momentum [kg m/s] and mass [kg], (nodes,)
):  # fmt: skip
    """Add momentum, mass and the impulse of the stress of some blocks to the nodes (P2G)."""
    for q in range(first * PAD, end * PAD):
        if q % PAD == 0:
            for p in range(start[q // PAD], stop[q // PAD]):
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
def accelerate(
    live: Indices,  # nodes near a particle, (L,)
    nodes: Nodes,  # in: momentum and mass; out: velocity [m/s], (nodes,)
):
    """Turn momenta into velocities, reduced by the grid's decay."""
    for q in live:
        n = nodes[live[q]]
        if n[3] > 0:
            nodes[live[q]] = n * (bar.KEEP / n[3])


@ti.kernel
def gather(
    dt: ti.f32, h: ti.f32,  # [s], [m]
    sx: ti.i32, sy: ti.i32,  # nodes from one to the next along x, along y
    x: Vectors, v: Vectors,  # in and out: [m], [m/s], (N,)
    C: Matrices, F: Matrices,  # in and out: [1/s], [1], (N,)
    nodes: Nodes,  # velocity [m/s], (nodes,)
):  # fmt: skip
    """Update velocities, positions and deformation gradients of the particles from the nodes (G2P)."""
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
        """Positions X (N, 3) [m] and velocities v (N, 3) [m/s]; `cells` along the domain."""
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
        """Nodes (L,) within reach of particles in `cell` (N, 3) as long as these move by less than a cell."""
        near = np.zeros(self.shape, bool)
        for offset in np.ndindex(5, 5, 5):
            near[tuple((cell + offset - 1).T)] = True
        return np.flatnonzero(near)

    def __len__(self) -> int:
        return int(self.x.shape[0])

    def run(self, substeps: int) -> None:
        """Advance by `substeps` of length DT."""
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
        """Present positions [m], (N, 3), in the order of X."""
        out = np.empty((len(self.order), 3))
        out[self.order] = self.x.to_numpy() + self.lowest * self.h
        return out


def _colour(block: Array) -> tuple[Array, Array, Array, list[int]]:
    """Order of the particles by block, from the block of each particle, (N, 3).

    Returns particle indices by block, (N,), first particle and end of each block in the order of colours, (blocks,)
    each, and the first block of each of the eight colours with the end of the last, 9 numbers.
    """
    size = block.max(axis=0) + 1
    key = np.ravel_multi_index(tuple(block.T), tuple(size))
    order = np.argsort(key, kind="stable")
    used, start, count = np.unique(key[order], return_index=True, return_counts=True)
    colour = np.stack(np.unravel_index(used, tuple(size)), axis=1) % 2 @ (4, 2, 1)
    by_colour = np.argsort(colour, kind="stable")
    bounds = np.searchsorted(colour[by_colour], np.arange(9)).tolist()
    return order, start[by_colour], (start + count)[by_colour], bounds


def _indices(values: Array) -> ti.Ndarray:
    """Integers (n,) as an array of Taichi, (n,) int32."""
    array = ti.ndarray(ti.i32, len(values))
    array.from_numpy(values.astype(np.int32))
    return array
