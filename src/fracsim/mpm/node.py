"""What one node does in a substep: sum the threads' copies, accelerate, obey grips and walls."""

import taichi as ti

from fracsim.mpm.boundary import IN_EDGE
from fracsim.mpm.constraint import constrain, edge_impulse, grip_at
from fracsim.mpm.leapfrog import kick
from fracsim.mpm.params import (
    ALPHA,
    CELL,
    DECAYED,
    DENSITY,
    FIRST,
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
)
from fracsim.mpm.tally import add
from fracsim.mpm.transfer import projection_loss


@ti.func
def position(i, c: ti.template()):
    """Position of node i of the box relative to the object's centre [m]."""
    sx, sy = c.grid.sx, c.grid.sy
    return c.params[CELL] * ti.Vector([c.params[LX] + i // sx, c.params[LY] + i % sx // sy, c.params[LZ] + i % sy])


@ti.func
def is_heavy(mass, c: ti.template()):
    """Whether a node carries more than round-off."""
    return mass > 1e-12 * c.params[DENSITY] * c.params[CELL] ** 3


@ti.func
def collect(q, step, c: ti.template()):
    """Velocity and mass of node q after all forces but those of grips, (4,); empties the copies.

    In `total` nodes stay with their particles, so that a node keeps its velocity, of which a substep replaces only a
    part by what particles carry (`fracsim.mpm.timestep.projection`).
    """
    n = ti.static(c.nodes)
    g = ti.static(c.grid)
    sum4 = ti.Vector.zero(c.variant.real, 4)
    for t in range(n.source.shape[1]):
        s = n.source[q, t]
        if s >= 0:
            sum4 += g.momentum[s]
            g.momentum[s] = ti.Vector.zero(c.variant.real, 4)
    mass = sum4[3]
    v = ti.Vector.zero(c.variant.real, 3)
    if is_heavy(mass, c):
        v = ti.Vector([sum4[0], sum4[1], sum4[2]]) / mass
        if ti.static(c.variant.total):
            if step > 0 or c.params[FIRST] == 0:
                old = g.velocity[n.index[q]]
                v += (1 - c.params[ALPHA]) * ti.Vector([old[0], old[1], old[2]])
        a = ti.Vector([c.params[GX], c.params[GY], c.params[GZ]])
        if a.norm_sqr() > 0:
            dt = kick(step, c)
            add(c.tally, GRAVITY_WORK, mass * dt * a.dot(v + (dt / 2) * a))
            v += dt * a
    return ti.Vector([v[0], v[1], v[2], mass])


@ti.func
def set_velocity(i, v, mass, driven, c: ti.template()):
    """Store the velocity of node i after decay and walls; `driven` is the part that grips prescribe [m/s]."""
    if c.params[KEEP] < 1:  # the driven part does not decay: the load would lack that part of the force
        free = v - driven
        add(c.tally, DECAYED, mass * free.dot(free) / 2 * (1 - c.params[KEEP] ** 2))
        v = driven + c.params[KEEP] * free
    if ti.static(not c.variant.total):
        x = position(i, c)
        if c.params[WALL] > 0 and ti.max(ti.abs(x[0]), ti.abs(x[1]), ti.abs(x[2])) > c.params[WALL]:
            v = ti.Vector.zero(c.variant.real, 3)
    add(c.tally, PROJECTED, projection_loss(c.params[ALPHA]) * mass * v.norm_sqr() / 2)
    c.grid.velocity[i] = ti.Vector([v[0], v[1], v[2], mass])


@ti.func
def constrain_edge(q, v4, step, c: ti.template()):
    """Move the edge before node q and the second node behind it; returns the velocity of q, given as v4."""
    n = ti.static(c.nodes)
    edge, second = n.edge[q, 0], n.edge[q, 1]
    e4, s4 = collect(edge, step, c), collect(second, step, c)
    e, v, s = ti.Vector([e4[0], e4[1], e4[2]]), ti.Vector([v4[0], v4[1], v4[2]]), ti.Vector([s4[0], s4[1], s4[2]])
    driven = ti.Vector.zero(c.variant.real, 3)
    if is_heavy(e4[3], c) and is_heavy(v4[3], c) and is_heavy(s4[3], c):
        grip, weights = n.grip[edge] // IN_EDGE, ti.Vector([n.edge_weights[q, 0], n.edge_weights[q, 1]])
        impulse = edge_impulse(grip, weights, e, v, s, ti.Vector([e4[3], v4[3], s4[3]]), c)
        e, v, s = e + impulse / e4[3], v - weights[0] * impulse / v4[3], s - weights[1] * impulse / s4[3]
        axis = ti.Vector([c.params[UX], c.params[UY], c.params[UZ]])
        driven = ((1 - weights[0] - weights[1]) * grip * c.params[SPEED]) * axis
    set_velocity(n.index[edge], e, e4[3], driven, c)
    set_velocity(n.index[second], s, s4[3], 0 * driven, c)
    return v


@ti.func
def update_node(q, step, middle, c: ti.template()):
    """A substep of node q; the grips' middle planes are at +-`middle` [m]."""
    n = ti.static(c.nodes)
    i, grip, edge = n.index[q], 0, -1
    if ti.static(c.variant.holds_nodes):
        grip = n.grip[q] if ti.static(c.variant.total) else grip_at(position(i, c), middle, c)
        if ti.static(c.variant.total):
            edge = n.edge[q, 0]
    if ti.abs(grip) != IN_EDGE:  # an edge and the second node behind it move together with the first one
        v4 = collect(q, step, c)
        v, driven = ti.Vector([v4[0], v4[1], v4[2]]), ti.Vector.zero(c.variant.real, 3)
        if ti.static(c.variant.holds_nodes):
            if grip != 0 and is_heavy(v4[3], c):
                v = constrain(grip, v4[3], v, c)
                driven = (grip * c.params[SPEED]) * ti.Vector([c.params[UX], c.params[UY], c.params[UZ]])
            if edge >= 0:
                v = constrain_edge(q, v4, step, c)
        set_velocity(i, v, v4[3], driven, c)
