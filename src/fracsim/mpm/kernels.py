"""The kernels that drive particles and nodes through substeps, one set a backend.

A call runs n substeps: scatter, then n times (nodes, gather [+ scatter]), so that a particle is visited once a
substep. On a CPU each thread owns a contiguous chunk of particles and a copy of the nodes these touch, which the
nodes sum: no atomics, no colours, the same result in each run. One thread runs all n substeps in one serial kernel,
since starting a parallel loop costs 50-90 us. On a GPU there is one chunk, and scattering is atomic.
"""

from functools import cache
from typing import Any

import taichi as ti

from fracsim.mpm.node import Nodes, node_function
from fracsim.mpm.params import DT, PARAMETERS, REACH, SPEED, TIME
from fracsim.mpm.particle import Points, particle_function
from fracsim.mpm.tally import Ledger
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


@cache
def substeps(law: str, damage: str, total: bool, cellwise: bool, viscous: bool, forced: bool, grips: str,
             drive: str, real: Any, wide: Any) -> Any:  # fmt: skip
    """The kernel that runs substeps; `drive` is `serial`, `threads` or `gpu`, `wide` the type of the books.

    Arguments of `serial`: n, parameters, particles (X, U, V, C, H, D, volume, tag, anchor, force, many, theta, wait),
    strides (sx, sy, sz) and the number 0, velocity, copies, pad, nodes (index, owner, tied, share, source),
    shift, start, books, faults, halt. The other two run one substep: its number and whether to gather and to scatter
    stand in n's place.
    """
    visit = particle_function(law, damage, total, cellwise, viscous, forced, grips, real)
    node = node_function(total, grips, real)
    Scalar, Vector, Vector4, Matrix, Index, Table, Scalars, Vectors4 = types(real).values()
    Books = ti.types.ndarray(dtype=wide, ndim=2)

    @ti.func
    def read(parameters: ti.template()):
        """The parameters as numbers, which are read once and not after each store."""
        return ti.Vector([parameters[k] for k in ti.static(range(PARAMETERS))])

    @ti.func
    def stop(halt: ti.template()):
        """The substep after which somebody wants to stop; what one learns in this substep changes nothing in it."""
        least = halt[0]
        for c in range(1, halt.shape[0]):
            least = ti.min(least, halt[c])
        return least

    @ti.func
    def middle(step, K: ti.template()):
        """Distance of the grips' middle planes from the centre at the end of a substep."""
        return K[REACH] if ti.static(total) else K[REACH] + K[SPEED] * (K[TIME] + step * K[DT])

    @ti.kernel
    def serial(n: ti.i32, parameters: Scalar, X: Vector, U: Vector, V: Vector, C: Matrix, H: Matrix, D: Scalar,
               volume: Scalar, tag: Index, anchor: Vector, force: Vector, many: Index, theta: Scalar, wait: Vectors4,
               sx: ti.i32, sy: ti.i32, sz: ti.i32, blank: real, velocity: Vector4, copies: Vector4, pad: Vector4,
               index: Index, owner: Index, tied: Table, share: Scalars, source: Table, shift: Index,
               start: Index, books: Books, faults: Table, halt: Index):  # fmt: skip
        ti.loop_config(serialize=True)
        for _ in range(1):
            K = read(parameters)
            for step in range(n + 1):
                more = step < n and step <= halt[0]
                if faults[0, 0] == 0 and step - 1 <= halt[0]:
                    for p in range(X.shape[0]):
                        visit.whole(p, step, step > 0, more, 0 + shift[0], K,
                                 ti.static(Points(X, U, V, C, H, D, volume, tag, anchor, force, many, theta, wait)),
                                 ti.static(Grid(sx, sy, sz, velocity, copies, pad, blank, False)),
                                 ti.static(Ledger(0, books, faults, halt, False)))  # fmt: skip
                    if more:
                        for q in range(index.shape[0]):
                            node(q, step, middle(step + 1, K), K,
                                 ti.static(Nodes(index, owner, tied, share, source)),
                                 ti.static(Grid(sx, sy, sz, velocity, copies, pad, blank, False)),
                                 ti.static(Ledger(0, books, faults, halt, False)))  # fmt: skip

    @ti.kernel
    def threads(step: ti.i32, gathers: ti.i32, scatters: ti.i32, parameters: Scalar, X: Vector, U: Vector, V: Vector,
                C: Matrix, H: Matrix, D: Scalar, volume: Scalar, tag: Index, anchor: Vector, force: Vector,
                many: Index, theta: Scalar, wait: Vectors4, sx: ti.i32, sy: ti.i32, sz: ti.i32, blank: real,
                velocity: Vector4, copies: Vector4, pad: Vector4, index: Index, owner: Index, tied: Table,
                share: Scalars, source: Table, shift: Index, start: Index, books: Books, faults: Table,
                halt: Index):  # fmt: skip
        for q in range(shift.shape[0] * CHUNK):
            if q % CHUNK == 0 and faults[q // CHUNK, 0] == 0 and step - 1 <= stop(halt):
                c, K, more = q // CHUNK, read(parameters), scatters == 1 and step <= stop(halt)
                for p in range(start[c], start[c + 1]):
                    visit.whole(p, step, gathers == 1, more, shift[c], K,
                             ti.static(Points(X, U, V, C, H, D, volume, tag, anchor, force, many, theta, wait)),
                             ti.static(Grid(sx, sy, sz, velocity, copies, pad, blank, False)),
                             ti.static(Ledger(c, books, faults, halt, False)))  # fmt: skip
        for q in range(shift.shape[0] * CHUNK):
            if q % CHUNK == 0 and scatters == 1 and step <= stop(halt):
                c, chunks, K = q // CHUNK, shift.shape[0], read(parameters)
                for i in range(c * index.shape[0] // chunks, (c + 1) * index.shape[0] // chunks):
                    node(i, step, middle(step + 1, K), K,
                         ti.static(Nodes(index, owner, tied, share, source)),
                         ti.static(Grid(sx, sy, sz, velocity, copies, pad, blank, False)),
                         ti.static(Ledger(c, books, faults, halt, False)))  # fmt: skip

    @ti.kernel
    def gpu(step: ti.i32, gathers: ti.i32, scatters: ti.i32, parameters: Scalar, X: Vector, U: Vector, V: Vector,
            C: Matrix, H: Matrix, D: Scalar, volume: Scalar, tag: Index, anchor: Vector, force: Vector,
            many: Index, theta: Scalar, wait: Vectors4, sx: ti.i32, sy: ti.i32, sz: ti.i32, blank: real,
            velocity: Vector4, copies: Vector4, pad: Vector4, index: Index, owner: Index, tied: Table,
            share: Scalars, source: Table, shift: Index, start: Index, books: Books, faults: Table,
            halt: Index):  # fmt: skip
        for stage in ti.static(visit.stages):
            for p in range(X.shape[0]):
                if faults[0, 0] == 0 and step - 1 <= halt[0]:
                    more = scatters == 1 and step <= halt[0]
                    stage(p, step, gathers == 1, more, shift[0], parameters,
                          ti.static(Points(X, U, V, C, H, D, volume, tag, anchor, force, many, theta, wait)),
                          ti.static(Grid(sx, sy, sz, velocity, copies, pad, blank, True)),
                          ti.static(Ledger(0, books, faults, halt, True)))  # fmt: skip
        for i in range(index.shape[0]):
            if scatters == 1 and step <= halt[0]:
                node(i, step, middle(step + 1, parameters), parameters,
                     ti.static(Nodes(index, owner, tied, share, source)),
                     ti.static(Grid(sx, sy, sz, velocity, copies, pad, blank, True)),
                     ti.static(Ledger(0, books, faults, halt, True)))  # fmt: skip

    return {"serial": serial, "threads": threads, "gpu": gpu}[drive]
