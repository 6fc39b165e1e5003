"""What holds a body: nothing (`Free`), a wall (`Clamp`), or two grips that move apart (`fracsim.mpm.grips.Grips`).

A boundary says which particles and nodes it holds and how fast it moves them; the Taichi functions below prescribe the
velocities and add up impulse and work.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import taichi as ti

from fracsim.mpm.layout import Layout
from fracsim.mpm.params import GRIP_WORK, HALF, PULL_HIGH, PULL_LOW, REACH, SPEED, UX, UY, UZ
from fracsim.mpm.tally import add
from fracsim.records import Array

IN_EDGE = 2
"""Times the grip, -1 or +1: marks an edge and the second node behind it, which move together with the first one."""
FAR = 10.0
"""Beyond all bodies [m]."""


class Holding(NamedTuple):
    """How a boundary holds the M nodes of a layout.

    A grip's face lies anywhere between nodes. The node after the last held one, the edge, moves by a weighted sum of
    the two nodes behind it, all relative to the grip, so that the stretched part ends at the face, and not up to half a
    cell before or behind it (`fracsim.mpm.ends`). This is a constraint, not a force: it costs no substeps.
    """

    grip: Array
    """The grip, -1 or +1, that each node moves with, 0 if it is free, IN_EDGE times the grip for an edge and for the
    second node behind it, (M,) int32."""
    edge: Array
    """The edge and the second node behind it, for the first node behind an edge, else -1, (M, 2) int32."""
    weights: Array
    """Weights of the first and of the second node in the edge's velocity, (M, 2) float64."""

    @classmethod
    def by(cls, grip: Array) -> "Holding":
        """Held by grips, (M,), without edges."""
        return cls(grip.astype(np.int32), np.full((len(grip), 2), -1, np.int32), np.zeros((len(grip), 2)))


class Boundary(Protocol):
    """What `State` asks of a boundary; positions x are relative to the object's centre."""

    @property
    def mode(self) -> str:
        """`rigid`, `sliding` (free across the axis), `soft` (particles only, before the transfer) or `free`."""

    @property
    def speed(self) -> float:
        """Speed of both grips [m/s]."""

    @property
    def axis(self) -> tuple[float, float, float]:
        """Unit vector along which the upper grip moves."""

    def side(self, x: Array) -> Array:
        """The grip, -1 or +1, that holds each particle at rest at x [m], (N, 3), 0 if none does, (N,) int32."""

    def exempt(self, x: Array) -> Array:
        """Which particles at rest at x [m], (N, 3), gather no damage, (N,) bool."""

    def holding(self, layout: Layout, x: Array) -> Holding:
        """How it holds the nodes of a layout, at rest at x [m], (M, 3) (`total`)."""

    def fill(self, params: Array) -> None:
        """Set the slots of the grips in the kernels' parameters."""


@dataclass(frozen=True)
class Free:
    """Holds nothing."""

    mode = "free"
    speed = 0.0
    axis = (1.0, 0.0, 0.0)

    def side(self, x: Array) -> Array:
        """0 for all particles, (N,) int32."""
        return np.zeros(len(x), np.int32)

    def exempt(self, x: Array) -> Array:
        """No particle, (N,) bool."""
        return np.zeros(len(x), bool)

    def holding(self, layout: Layout, x: Array) -> Holding:
        """No node."""
        return Holding.by(np.zeros(len(x)))

    def fill(self, params: Array) -> None:
        """Kernels of a free body read none of the slots."""


@dataclass(frozen=True)
class Clamp(Free):
    """Holds at rest whatever is at x <= -wall [m from the object's centre]; the body must stay below x = wall - 3 h."""

    wall: float = math.inf
    mode = "rigid"

    def side(self, x: Array) -> Array:
        """-1 for held particles, (N,) int32."""
        return -np.asarray(x[:, 0] <= 1e-6 - self.wall).astype(np.int32)

    def holding(self, layout: Layout, x: Array) -> Holding:
        """Nodes on the wall and behind it."""
        return Holding.by(self.side(x))

    def fill(self, params: Array) -> None:
        """Two slabs, FAR thick, from the wall outwards."""
        params[SPEED], params[UX : UZ + 1] = 0.0, self.axis
        params[HALF], params[REACH] = FAR + 1e-6, self.wall + FAR


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
