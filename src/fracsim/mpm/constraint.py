"""The velocities that a boundary prescribes, and the impulse and work that this takes."""

import taichi as ti

from fracsim.mpm.params import GRIP_WORK, HALF, PULL_HIGH, PULL_LOW, SPEED, UX, UY, UZ
from fracsim.mpm.tally import add


@ti.func
def grip_at(x, middle, c: ti.template()):
    """The grip, -1 or +1, that holds a node at x [m], or 0; slabs have their middle planes at +-middle [m]."""
    s = x[0] * c.params[UX] + x[1] * c.params[UY] + x[2] * c.params[UZ]
    grip = 0
    if ti.abs(ti.abs(s) - middle) <= c.params[HALF]:
        grip = 1 if s > 0 else -1
    return grip


@ti.func
def prescribed_velocity(grip, v, c: ti.template()):
    """The velocity that a grip gives to what would move with v [m/s]."""
    u = ti.Vector([c.params[UX], c.params[UY], c.params[UZ]])
    along = grip * c.params[SPEED]
    return v + (along - v.dot(u)) * u if ti.static(c.variant.boundary == "sliding") else along * u


@ti.func
def constrain(grip, mass, v, c: ti.template()):
    """The velocity that a grip gives to `mass` moving with v; adds up its impulse and its work."""
    u = ti.Vector([c.params[UX], c.params[UY], c.params[UZ]])
    add_impulse(grip, mass * (grip * c.params[SPEED] - v.dot(u)), c)
    return prescribed_velocity(grip, v, c)


@ti.func
def add_impulse(grip, impulse, c: ti.template()):
    """Add an impulse of a grip along the axis [N s], and its work."""
    slot = PULL_LOW
    if grip > 0:
        slot = PULL_HIGH
    add(c.tally, slot, impulse)
    add(c.tally, GRIP_WORK, impulse * grip * c.params[SPEED])


@ti.func
def edge_impulse(grip, weights, e, v, s, mass, c: ti.template()):
    """The impulse on an edge [N s] after which e = weights[0] v + weights[1] s, all relative to the grip.

    v and s are the velocities of the first and second node behind the edge, which get -weights times the impulse: this
    changes the kinetic energy least. `mass` is that of the three nodes, (3,).
    """
    u = ti.Vector([c.params[UX], c.params[UY], c.params[UZ]])
    drive = (grip * c.params[SPEED]) * u
    near, far = weights[0], weights[1]
    short = near * (v - drive) + far * (s - drive) - (e - drive)
    if ti.static(c.variant.boundary == "sliding"):
        short = short.dot(u) * u
    impulse = short / (1 / mass[0] + near * near / mass[1] + far * far / mass[2])
    add_impulse(grip, (1 - near - far) * impulse.dot(u), c)
    return impulse
