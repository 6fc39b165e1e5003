"""What one node does in a substep: sum the copies, accelerate, obey grips and walls."""

from functools import cache
from typing import Any, NamedTuple

import taichi as ti

from fracsim.mpm.grips import TIED, grip_of_node, hold, tie
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
from fracsim.mpm.tally import tally
from fracsim.mpm.transfer import projection_loss


class Nodes(NamedTuple):
    """The nodes near a particle: M of those in the box."""

    index: Any
    """Which nodes of the box, (M,)."""
    owner: Any
    """How grips hold each, (M,); of the rest configuration, see `fracsim.mpm.grips.Holding`."""
    tied: Any
    """Which two of the M nodes are tied to each, the edge and the one behind it, or -1, (M, 2)."""
    share: Any
    """Shares of this node and of the one behind it in the edge's velocity, (M, 2)."""
    source: Any
    """Where each lies in each thread's copy, or -1, (M, threads)."""


@ti.func
def place(i, g: ti.template(), K: ti.template()):
    """Position of node i of the box relative to the object's centre [m]."""
    return K[H] * ti.Vector([K[LX] + i // g.sx, K[LY] + i % g.sx // g.sy, K[LZ] + i % g.sy])


@ti.func
def heavy(mass, K: ti.template()):
    """Whether a node carries more than round-off."""
    return mass > 1e-12 * K[DENSITY] * K[H] ** 3


@cache
def node_function(total: bool, grips: str, real: Any) -> Any:
    """The function `node`: momentum in the copies becomes velocity, and the copies are emptied.

    In `total` nodes stay with their particles, so that a node keeps its velocity, of which a part only is replaced by
    what particles carry (see `fracsim.mpm.timestep.projection`). There it is known at rest, too, who holds a node.
    """
    held = grips != "soft"

    @ti.func
    def collect(q, step, K: ti.template(), n: ti.template(), g: ti.template(), ledger: ti.template()):
        """Velocity and mass of node q after all forces but those of grips, (4,)."""
        sum4 = ti.Vector.zero(real, 4)
        for c in range(n.source.shape[1]):
            s = n.source[q, c]
            if s >= 0:
                sum4 += g.copies[s]
                g.copies[s] = ti.Vector.zero(real, 4)
        mass = sum4[3]
        v = ti.Vector.zero(real, 3)
        if heavy(mass, K):
            v = ti.Vector([sum4[0], sum4[1], sum4[2]]) / mass
            if ti.static(total):
                if step > 0 or K[FRESH] == 0:
                    old = g.velocity[n.index[q]]
                    v += (1 - K[ALPHA]) * ti.Vector([old[0], old[1], old[2]])
            a = ti.Vector([K[GX], K[GY], K[GZ]])
            if a.norm_sqr() > 0:
                tally(ledger, GRAVITY_WORK, mass * K[DT] * a.dot(v + (K[DT] / 2) * a))
                v += K[DT] * a
        return ti.Vector([v[0], v[1], v[2], mass])

    @ti.func
    def leave(i, v, mass, driven, K: ti.template(), g: ti.template(), ledger: ti.template()):
        """Let node i, which grips drive with `driven`, move with v."""
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

    @ti.func
    def tied(q, v4, step, K: ti.template(), n: ti.template(), g: ti.template(), ledger: ti.template()):
        """Move the edge and the node behind q, which itself moves with v4; returns its velocity."""
        edge, behind = n.tied[q, 0], n.tied[q, 1]
        e4, b4 = collect(edge, step, K, n, g, ledger), collect(behind, step, K, n, g, ledger)
        e, v, b = ti.Vector([e4[0], e4[1], e4[2]]), ti.Vector([v4[0], v4[1], v4[2]]), ti.Vector([b4[0], b4[1], b4[2]])
        lead = ti.Vector.zero(real, 3)
        if heavy(e4[3], K) and heavy(v4[3], K) and heavy(b4[3], K):
            grip, near, far = n.owner[edge] // TIED, n.share[q, 0], n.share[q, 1]
            impulse = tie(ledger, grip, near, far, e, v, b, ti.Vector([e4[3], v4[3], b4[3]]), K, grips)
            e, v, b = e + impulse / e4[3], v - near * impulse / v4[3], b - far * impulse / b4[3]
            lead = ((1 - near - far) * grip * K[SPEED]) * ti.Vector([K[UX], K[UY], K[UZ]])
        leave(n.index[edge], e, e4[3], lead, K, g, ledger)
        leave(n.index[behind], b, b4[3], 0 * lead, K, g, ledger)
        return v

    @ti.func
    def node(q, step, middle, K: ti.template(), n: ti.template(), g: ti.template(), ledger: ti.template()):
        i, grip, edge = n.index[q], 0, -1
        if ti.static(held):
            grip = n.owner[q] if ti.static(total) else grip_of_node(place(i, g, K), middle, K)
            if ti.static(total):
                edge = n.tied[q, 0]
        if ti.abs(grip) != TIED:  # those are moved together with the node that they are tied to
            v4 = collect(q, step, K, n, g, ledger)
            v, driven = ti.Vector([v4[0], v4[1], v4[2]]), ti.Vector.zero(real, 3)
            if ti.static(held):
                if grip != 0 and heavy(v4[3], K):
                    v = hold(ledger, grip, v4[3], v, K, grips)
                    driven = (grip * K[SPEED]) * ti.Vector([K[UX], K[UY], K[UZ]])
                if edge >= 0:
                    v = tied(q, v4, step, K, n, g, ledger)
            leave(i, v, v4[3], driven, K, g, ledger)

    return node
