"""What one node does in a substep: sum the copies, accelerate, obey grips and walls."""

from functools import cache
from typing import Any

import taichi as ti

from fracsim.mpm.books import tally
from fracsim.mpm.grips import grip_of_node, hold
from fracsim.mpm.params import (
    DECAYED,
    DENSITY,
    DT,
    GRAVITY_WORK,
    GX,
    GY,
    GZ,
    KEEP,
    LX,
    LY,
    LZ,
    WALL,
    H,
)  # fmt: skip


@ti.func
def place(i, sx, sy, K: ti.template()):
    """Position of node i of the box relative to the object's centre [m]."""
    return K[H] * ti.Vector([K[LX] + i // sx, K[LY] + i % sx // sy, K[LZ] + i % sy])


@cache
def node_function(total: bool, grips: str, atomic: bool, real: Any) -> Any:
    """The function `node`: momentum in `copies` becomes velocity in `grid`, and `copies` is emptied."""

    @ti.func
    def node(q, row, middle, sx, sy, K: ti.template(), nodes: ti.template(), owner: ti.template(),
             source: ti.template(), grid: ti.template(), copies: ti.template(), books: ti.template()):  # fmt: skip
        i = nodes[q]
        sum4 = ti.Vector.zero(real, 4)
        for c in range(source.shape[1]):
            s = source[q, c]
            if s >= 0:
                sum4 += copies[s]
                copies[s] = ti.Vector.zero(real, 4)
        mass = sum4[3]
        v = ti.Vector.zero(real, 3)
        if mass > 1e-12 * K[DENSITY] * K[H] ** 3:  # lighter nodes carry nothing but round-off
            v = ti.Vector([sum4[0], sum4[1], sum4[2]]) / mass
            g = ti.Vector([K[GX], K[GY], K[GZ]])
            if g.norm_sqr() > 0:
                tally(books, row, GRAVITY_WORK, mass * K[DT] * g.dot(v + (K[DT] / 2) * g), atomic)
                v += K[DT] * g
            if K[KEEP] < 1:
                tally(books, row, DECAYED, mass * v.dot(v) / 2 * (1 - K[KEEP] ** 2), atomic)
                v *= K[KEEP]
            if ti.static(grips != "soft"):  # at rest it is known who holds a node; later the grips have moved on
                grip = owner[q] if ti.static(total) else grip_of_node(place(i, sx, sy, K), middle, K)
                if grip != 0:
                    v = hold(books, row, grip, mass, v, K, grips, atomic)
            if ti.static(not total):
                x = place(i, sx, sy, K)
                if K[WALL] > 0 and ti.max(ti.abs(x[0]), ti.abs(x[1]), ti.abs(x[2])) > K[WALL]:
                    v = ti.Vector.zero(real, 3)
        grid[i] = ti.Vector([v[0], v[1], v[2], mass])

    return node
