"""The kernel that drives particles and nodes through substeps, compiled for each variant of scene and machine.

A substep updates the nodes, then visits each particle once: it gathers from the nodes and scatters for the next
substep. So a call of n substeps scatters once, then n times updates nodes and gathers, and the last gathering scatters
no more. On a CPU each thread owns a contiguous chunk of particles and a copy of the nodes that these touch; the nodes
sum the copies: no atomics, no colours, the same result in each run. One thread runs all n substeps in one serial
launch, since starting a parallel loop costs 50-90 us. On a GPU there is one chunk, and scattering is atomic.
"""

from functools import cache
from typing import Any

import taichi as ti

from fracsim.mpm.context import Context, NodeArrays, ParticleArrays, Variant
from fracsim.mpm.node import update_node
from fracsim.mpm.params import DT, PARAMETERS, REACH, SPEED, TIME
from fracsim.mpm.particle import stages, whole
from fracsim.mpm.tally import Tally
from fracsim.mpm.transfer import Grid

CHUNK = 512
"""Taichi's CPU backend never splits a range loop finer than this: a loop over heavy items is padded by it."""


@cache
def types(real: Any) -> dict[str, Any]:
    """The ndarray types of kernel arguments for one floating-point type."""
    array = ti.types.ndarray
    return {
        "scalar": array(dtype=real, ndim=1),
        "vector": array(dtype=ti.types.vector(3, real), ndim=1),
        "vector4": array(dtype=ti.types.vector(4, real), ndim=1),
        "matrix": array(dtype=ti.types.matrix(3, 3, real), ndim=1),
        "index": array(dtype=ti.i32, ndim=1),
        "table": array(dtype=ti.i32, ndim=2),
        "scalars": array(dtype=real, ndim=2),
        "vectors4": array(dtype=ti.types.vector(4, real), ndim=2),
    }


@ti.func
def read(params: ti.template()):
    """The parameters as local numbers: a kernel then need not read them again after each store."""
    return ti.Vector([params[k] for k in ti.static(range(PARAMETERS))])


@ti.func
def last_step(last: ti.template()):
    """Last substep to run: the earliest that any thread asked for. A request of this substep does not change it."""
    least = last[0]
    for c in range(1, last.shape[0]):
        least = ti.min(least, last[c])
    return least


@ti.func
def middle(step, total: ti.template(), params: ti.template()):
    """Distance of the grips' middle planes from the centre at the end of a substep [m]; at rest for `total`."""
    return params[REACH] if ti.static(total) else params[REACH] + params[SPEED] * (params[TIME] + step * params[DT])


@cache
def substeps(variant: Variant, drive: str, wide: Any) -> Any:
    """The kernel of substeps; `drive` is `serial`, `threads` or `gpu`, `wide` the floating-point type of the sums.

    `serial` runs all `count` substeps in one launch. The other two run one launch a substep, step = 0 .. count.
    """
    Scalar, Vector, Vector4, Matrix, Index, Table, Scalars, Vectors4 = types(variant.real).values()
    Sums = ti.types.ndarray(dtype=wide, ndim=2)
    total, visit, in_stages, atomic = variant.total, whole(variant), stages(variant), drive == "gpu"

    @ti.kernel
    def run(
        step: ti.i32, count: ti.i32,
        params: Scalar,  # (PARAMETERS,)
        X: Vector, U: Vector, V: Vector,  # (N,) particles: see `ParticleArrays` for units
        C: Matrix, grad_u: Matrix,  # (N,)
        D: Scalar, volume: Scalar,  # (N,)
        tag: Index, anchor: Vector, force: Vector,  # (N,)
        cell_counts: Index, theta: Scalar, scratch: Vectors4,  # (N,), (N,), (threads, places)
        sx: ti.i32, sy: ti.i32, sz: ti.i32, zero: variant.real,  # grid: see `Grid`
        velocity: Vector4, momentum: Vector4, pad: Vector4,  # (size,), (copies,), (threads * PAD,)
        index: Index, grip: Index, edge: Table, edge_weights: Scalars,  # nodes: see `NodeArrays`; (M,) and (M, 2)
        source: Table,  # (M, threads)
        shift: Index, start: Index,  # (threads,), (threads + 1,): see `fracsim.mpm.layout.Layout`
        sums: Sums, faults: Table, last: Index,  # tally: see `Tally`; (threads, SUMS), (threads, 3), (threads,)
    ):  # fmt: skip
        particles = ti.static(
            ParticleArrays(X, U, V, C, grad_u, D, volume, tag, anchor, force, cell_counts, theta, scratch)
        )
        nodes = ti.static(NodeArrays(index, grip, edge, edge_weights, source))
        grid = ti.static(Grid(sx, sy, sz, velocity, momentum, pad, zero, atomic))
        if ti.static(drive == "serial"):
            ti.loop_config(serialize=True)
            for _ in range(1):
                K = read(params)
                c = ti.static(Context(variant, K, particles, nodes, grid, Tally(0, sums, faults, last, False)))
                for k in range(count + 1):
                    more = k < count and k <= last[0]
                    if faults[0, 0] == 0 and k - 1 <= last[0]:
                        for p in range(X.shape[0]):
                            visit(p, k > 0, more, k, 0 + shift[0], c)
                        if more:
                            for q in range(index.shape[0]):
                                update_node(q, k, middle(k + 1, total, K), c)
        elif ti.static(drive == "threads"):
            for q in range(shift.shape[0] * CHUNK):
                t = q // CHUNK
                if q % CHUNK == 0 and faults[t, 0] == 0 and step - 1 <= last_step(last):
                    K, more = read(params), step < count and step <= last_step(last)
                    c = ti.static(Context(variant, K, particles, nodes, grid, Tally(t, sums, faults, last, False)))
                    for p in range(start[t], start[t + 1]):
                        visit(p, step > 0, more, step, shift[t], c)
            for q in range(shift.shape[0] * CHUNK):
                if q % CHUNK == 0 and step < count and step <= last_step(last):
                    t, chunks, K = q // CHUNK, shift.shape[0], read(params)
                    c = ti.static(Context(variant, K, particles, nodes, grid, Tally(t, sums, faults, last, False)))
                    for i in range(t * index.shape[0] // chunks, (t + 1) * index.shape[0] // chunks):
                        update_node(i, step, middle(step + 1, total, K), c)
        else:
            c = ti.static(Context(variant, params, particles, nodes, grid, Tally(0, sums, faults, last, True)))
            for stage in ti.static(in_stages):
                for p in range(X.shape[0]):
                    if faults[0, 0] == 0 and step - 1 <= last[0]:
                        stage(p, step > 0, step < count and step <= last[0], step, shift[0], c)
            for i in range(index.shape[0]):
                if step < count and step <= last[0]:
                    update_node(i, step, middle(step + 1, total, params), c)

    return run
