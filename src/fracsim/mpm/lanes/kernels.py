"""The kernels that drive groups of cells through substeps (`fracsim.mpm.kernels`, WIDTH particles at a time).

Particles are copied into lanes before a call and back after it. That costs a tenth of a call of twelve substeps, and no
other part of a simulation needs to know of lanes.
"""

from functools import cache
from typing import Any

import numpy as np
import taichi as ti

from fracsim.lanes import WIDTH, entry, inline, vector
from fracsim.mpm.context import Context, NodeArrays, Variant
from fracsim.mpm.kernels import CHUNK, last_step, types
from fracsim.mpm.lanes.cell import update_group
from fracsim.mpm.lanes.record import (
    AFFINE,
    DAMAGE,
    EXCESS,
    FORCE,
    GRAD,
    GRIP,
    NEVER,
    OFFSET,
    SHIFT,
    VELOCITY,
    VOLUME,
    LaneArrays,
    nine,
    three,
)
from fracsim.mpm.node import update_node
from fracsim.mpm.params import ABOVE, EXEMPT, FREE, PARAMETERS
from fracsim.mpm.params import EXCESS as UNIT
from fracsim.mpm.tally import Tally
from fracsim.mpm.transfer import Grid


@cache
def lane_types(real: Any) -> tuple[Any, Any]:
    """The types of vectors of lanes, in one and in two dimensions."""
    lanes = ti.types.vector(WIDTH, real)
    return ti.types.ndarray(dtype=lanes, ndim=1), ti.types.ndarray(dtype=lanes, ndim=2)


@cache
def lane_substeps(variant: Variant, threads: bool, wide: Any) -> Any:
    """The kernel of substeps: on one thread all `count` of them in a launch, else one a launch, step = 0 .. count."""
    Scalar, _, Vector4, _, Index, Table, Scalars, _ = types(variant.real).values()
    Sums = ti.types.ndarray(dtype=wide, ndim=2)
    Lanes, Records = lane_types(variant.real)

    @ti.kernel
    def run(
        step: ti.i32, count: ti.i32,
        params: Scalar,  # (PARAMETERS,)
        rows: Table, owner: Lanes, particle: Table, record: Records, motion: Records, kept: Records,
        lane_pad: Lanes,  # `LaneArrays`
        slots: ti.i32, first: Index,  # places in `kept` of a thread; first group of each, (threads + 1,)
        sx: ti.i32, sy: ti.i32, sz: ti.i32, zero: variant.real,  # grid: see `Grid`
        velocity: Vector4, momentum: Vector4, pad: Vector4,  # (size,), (copies,), (threads * PAD,)
        index: Index, grip: Index, edge: Table, edge_weights: Scalars,  # nodes: see `NodeArrays`; (M,) and (M, 2)
        source: Table,  # (M, threads)
        shift: Index, start: Index,  # (threads,), (threads + 1,): see `fracsim.mpm.layout.Layout`
        sums: Sums, faults: Table, last: Index,  # tally: see `Tally`; (threads, SUMS), (threads, 3), (threads,)
    ):  # fmt: skip
        lanes = ti.static(LaneArrays(rows, owner, particle, record, motion, kept, lane_pad))
        nodes = ti.static(NodeArrays(index, grip, edge, edge_weights, source))
        grid = ti.static(Grid(sx, sy, sz, velocity, momentum, pad, zero, False))
        if ti.static(not threads):
            ti.loop_config(serialize=True)
            for _ in range(1):
                K = [params[k] for k in ti.static(range(PARAMETERS))]
                c = ti.static(Context(variant, K, lanes, nodes, grid, Tally(0, sums, faults, last, False)))
                for k in range(count + 1):
                    more = k < count and k <= last[0]
                    if faults[0, 0] == 0 and k - 1 <= last[0]:
                        for q in range(first[0], first[1]):
                            update_group(q, 0, k > 0, more, k, shift[0], c)
                        if more:
                            for i in range(index.shape[0]):
                                update_node(i, k, 0.0, c)
        else:
            for w in range(shift.shape[0] * CHUNK):
                t = w // CHUNK
                if w % CHUNK == 0 and faults[t, 0] == 0 and step - 1 <= last_step(last):
                    K = [params[k] for k in ti.static(range(PARAMETERS))]
                    more = step < count and step <= last_step(last)
                    c = ti.static(Context(variant, K, lanes, nodes, grid, Tally(t, sums, faults, last, False)))
                    for q in range(first[t], first[t + 1]):
                        update_group(q, t * slots, step > 0, more, step, shift[t], c)
            for w in range(shift.shape[0] * CHUNK):
                if w % CHUNK == 0 and step < count and step <= last_step(last):
                    t, chunks = w // CHUNK, shift.shape[0]
                    K = [params[k] for k in ti.static(range(PARAMETERS))]
                    c = ti.static(Context(variant, K, lanes, nodes, grid, Tally(t, sums, faults, last, False)))
                    for i in range(t * index.shape[0] // chunks, (t + 1) * index.shape[0] // chunks):
                        update_node(i, step, 0.0, c)

    return run


@cache
def exchange(real: Any, forced: bool) -> tuple[Any, Any]:
    """The kernels that copy particles into lanes, and back what substeps change."""
    Scalar, Vector, _, Matrix, Index, Table, *_ = types(real).values()
    _, Records = lane_types(real)

    @ti.kernel
    def load(
        particle: Table, record: Records, motion: Records,  # see `LaneArrays`
        offset: Vector, U: Vector, V: Vector, C: Matrix, grad_u: Matrix, D: Scalar, volume: Scalar, tag: Index,
        force: Vector,  # see `ParticleArrays`; offset from the lowest node [cells], (N,)
    ):  # fmt: skip
        for r in range(particle.shape[0]):
            p = [particle[r, l] for l in ti.static(range(WIDTH))]
            q = [ti.max(p[l], 0) for l in ti.static(range(WIDTH))]
            lanes = ti.static(range(WIDTH))
            damage = vector([ti.select(p[l] >= 0, D[q[l]], 1) for l in lanes])
            size = of_each(volume, q)
            record[r, DAMAGE], record[r, VOLUME] = damage, ti.select(damage < 1, size, 0 * size)
            record[r, EXCESS] = vector([excess_of(tag[q[l]], real) for l in lanes])
            record[r, GRIP] = vector([ti.cast(tag[q[l]] % EXEMPT - FREE, real) for l in lanes])
            for i in ti.static(range(3)):
                record[r, OFFSET + i], record[r, SHIFT + i] = of_each(offset, q, i), of_each(U, q, i)
                motion[r, VELOCITY + i] = of_each(V, q, i)
                if ti.static(forced):
                    record[r, FORCE + i] = of_each(force, q, i)
                for j in ti.static(range(3)):
                    record[r, GRAD + 3 * i + j] = of_each(grad_u, q, i, j)
                    motion[r, AFFINE + 3 * i + j] = of_each(C, q, i, j)

    @ti.kernel
    def store(
        particle: Table, record: Records, motion: Records,  # see `LaneArrays`
        U: Vector, V: Vector, C: Matrix, grad_u: Matrix, D: Scalar,  # out, see `ParticleArrays`
    ):  # fmt: skip
        for r in range(particle.shape[0]):
            d, u, v = record[r, DAMAGE], three(record, r, SHIFT), three(motion, r, VELOCITY)
            g, a = nine(record, r, GRAD), nine(motion, r, AFFINE)
            for l in ti.static(range(WIDTH)):
                p = particle[r, l]
                if p >= 0:
                    D[p] = d[l]
                    put_lane(U, p, u, l)
                    put_lane(V, p, v, l)
                    put_lane(grad_u, p, g, l)
                    put_lane(C, p, a, l)

    return load, store


@inline
def of_each(array, particles, *index):
    """An entry of each particle's value in an array, as a vector of lanes."""
    return vector([entry(entry(array, p), *index) if index else entry(array, p) for p in particles])


@inline
def put_lane(array, p, values, l):
    """Give particle p what stands in lane l of three vectors, or of a matrix of them."""
    own, matrix = entry(array, p), not isinstance(values, list)
    for index in np.ndindex(*((3, 3) if matrix else (3,))):
        entry(own, *index)._assign(entry(values[index] if matrix else values[index[0]], l))


@ti.func
def excess_of(tag, real: ti.template()):
    """The excess of strain by which a particle's thresholds rise, from its tag."""
    out = ti.cast(tag // ABOVE, real) * UNIT
    if tag & EXEMPT != 0:
        out = NEVER
    return out
