"""The kernels that drive groups of cells through substeps (`fracsim.mpm.kernels`, WIDTH particles at a time).

Particles are copied into lanes before a call and back after it: that costs as much as a fiftieth of a call, and all
other parts of a simulation need not know of lanes.
"""

from functools import cache
from typing import Any

import taichi as ti

from fracsim.lanes import WIDTH
from fracsim.mpm.context import Context, NodeArrays, Variant
from fracsim.mpm.kernels import CHUNK, last_step, types
from fracsim.mpm.lane_cell import AFFINE, DAMAGE, EXCESS, FORCE, GRAD, GRIP, MOTION, OFFSET, SHIFT, VELOCITY, VOLUME
from fracsim.mpm.lane_cell import LaneArrays, update_group
from fracsim.mpm.node import update_node
from fracsim.mpm.params import ABOVE, EXCESS as UNIT, EXEMPT, FREE, PARAMETERS
from fracsim.mpm.tally import Tally
from fracsim.mpm.transfer import Grid

NEVER = 1e6
"""Excess of strain of particles that gather no damage."""


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
            for l in range(WIDTH):
                p = particle[r, l]
                record[r, VOLUME][l], record[r, DAMAGE][l] = 0, 1
                if p >= 0:
                    record[r, DAMAGE][l] = D[p]
                    if D[p] < 1:
                        record[r, VOLUME][l] = volume[p]
                    excess = ti.cast(tag[p] // ABOVE, real) * UNIT
                    if tag[p] & EXEMPT != 0:
                        excess = NEVER
                    record[r, EXCESS][l] = excess
                    record[r, GRIP][l] = tag[p] % EXEMPT - FREE
                    for i in ti.static(range(3)):
                        record[r, OFFSET + i][l] = offset[p][i]
                        record[r, SHIFT + i][l] = U[p][i]
                        motion[r, VELOCITY + i][l] = V[p][i]
                        if ti.static(forced):
                            record[r, FORCE + i][l] = force[p][i]
                        for j in ti.static(range(3)):
                            record[r, GRAD + 3 * i + j][l] = grad_u[p][i, j]
                            motion[r, AFFINE + 3 * i + j][l] = C[p][i, j]

    @ti.kernel
    def store(
        particle: Table, record: Records, motion: Records,  # see `LaneArrays`
        U: Vector, V: Vector, C: Matrix, grad_u: Matrix, D: Scalar,  # out, see `ParticleArrays`
    ):  # fmt: skip
        for r in range(particle.shape[0]):
            for l in range(WIDTH):
                p = particle[r, l]
                if p >= 0:
                    D[p] = record[r, DAMAGE][l]
                    for i in ti.static(range(3)):
                        U[p][i] = record[r, SHIFT + i][l]
                        V[p][i] = motion[r, VELOCITY + i][l]
                        for j in ti.static(range(3)):
                            grad_u[p][i, j] = record[r, GRAD + 3 * i + j][l]
                            C[p][i, j] = motion[r, AFFINE + 3 * i + j][l]

    return load, store
