"""What one node does in a substep: sum the copies, accelerate, obey grips and walls."""

from functools import cache
from typing import Any, NamedTuple

import taichi as ti

from fracsim.mpm.books import tally
from fracsim.mpm.grips import grip_of_node, hold
from fracsim.mpm.params import (
    ALPHA,
    DECAYED,
    DENSITY,
    DT,
    FRESH,
    GRAVITY_WORK,
    GX,
    GY,
    GZ,
    KEEP,
    LX,
    LY,
    LZ,
    PROJECTED,
    SPEED,
    UX,
    UY,
    UZ,
    WALL,
    H,
)  # fmt: skip
from fracsim.mpm.transfer import projection_loss


class Nodes(NamedTuple):
    """The nodes near a particle: M of those in the box."""

    index: Any
    """Which nodes of the box, (M,)."""
    owner: Any
    """Which grip, -1, 0 or +1, each moves with, (M,); of the rest configuration."""
    source: Any
    """Where each lies in each thread's copy, or -1, (M, threads)."""


@ti.func
def place(i, g: ti.template(), K: ti.template()):
    """Position of node i of the box relative to the object's centre [m]."""
    return K[H] * ti.Vector([K[LX] + i // g.sx, K[LY] + i % g.sx // g.sy, K[LZ] + i % g.sy])


@cache
def node_function(total: bool, grips: str, real: Any) -> Any:
    """The function `node`: momentum in the copies becomes velocity, and the copies are emptied.

    In `total` nodes stay with their particles, so that a node keeps its velocity, of which a part only is replaced by
    what particles carry (see `fracsim.mpm.timestep.projection`).
    """

    @ti.func
    def node(q, step, middle, K: ti.template(), n: ti.template(), g: ti.template(), ledger: ti.template()):
        i = n.index[q]
        sum4 = ti.Vector.zero(real, 4)
        for c in range(n.source.shape[1]):
            s = n.source[q, c]
            if s >= 0:
                sum4 += g.copies[s]
                g.copies[s] = ti.Vector.zero(real, 4)
        mass = sum4[3]
        v = ti.Vector.zero(real, 3)
        if mass > 1e-12 * K[DENSITY] * K[H] ** 3:  # lighter nodes carry nothing but round-off
            v = ti.Vector([sum4[0], sum4[1], sum4[2]]) / mass
            if ti.static(total):
                if step > 0 or K[FRESH] == 0:
                    old = g.velocity[i]
                    v += (1 - K[ALPHA]) * ti.Vector([old[0], old[1], old[2]])
            a = ti.Vector([K[GX], K[GY], K[GZ]])
            if a.norm_sqr() > 0:
                tally(ledger, GRAVITY_WORK, mass * K[DT] * a.dot(v + (K[DT] / 2) * a))
                v += K[DT] * a
            driven = ti.Vector.zero(real, 3)
            if ti.static(grips != "soft"):  # at rest it is known who holds a node; later the grips have moved on
                grip = n.owner[q] if ti.static(total) else grip_of_node(place(i, g, K), middle, K)
                if grip != 0:
                    v = hold(ledger, grip, mass, v, K, grips)
                    driven = (grip * K[SPEED]) * ti.Vector([K[UX], K[UY], K[UZ]])
            if K[KEEP] < 1:  # what a grip drives does not decay, or the load would lack that part of the force
                free = v - driven
                tally(ledger, DECAYED, mass * free.dot(free) / 2 * (1 - K[KEEP] ** 2))
                v = driven + K[KEEP] * free
            if ti.static(not total):
                x = place(i, g, K)
                if K[WALL] > 0 and ti.max(ti.abs(x[0]), ti.abs(x[1]), ti.abs(x[2])) > K[WALL]:
                    v = ti.Vector.zero(real, 3)
        tally(ledger, PROJECTED, projection_loss(K[ALPHA]) * mass * v.norm_sqr() / 2)
        g.velocity[i] = ti.Vector([v[0], v[1], v[2], mass])

    return node
