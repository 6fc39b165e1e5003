"""What holds a body: nothing (`Free`), a wall (`Clamp`), or two grips that move apart (`fracsim.mpm.grips.Grips`).

A boundary says which particles and nodes it holds and how fast it moves them; `fracsim.mpm.constraint` prescribes the
velocities and adds up impulse and work.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from fracsim.mpm.layout import Layout
from fracsim.mpm.params import HALF, REACH, SPEED, UX, UZ
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

    def excess(self, x: Array, spacing: float) -> Array:
        """By how much particles at rest at x [m], (N, 3), strain more where the load enters, relative, (N,).

        `spacing` [m] is that of neighbours in a body.
        """

    def holding(self, layout: Layout, x: Array) -> Holding:
        """How it holds the nodes of a layout, at rest at x [m], (M, 3) (`total`)."""

    def fill(self, params: Array) -> None:
        """Set the slots of the grips in the kernels' parameters, (PARAMETERS,)."""


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

    def excess(self, x: Array, spacing: float) -> Array:
        """0 for all particles, (N,)."""
        return np.zeros(len(x))

    def holding(self, layout: Layout, x: Array) -> Holding:
        """No node of x, (M, 3)."""
        return Holding.by(np.zeros(len(x)))

    def fill(self, params: Array) -> None:
        """Kernels of a free body read none of the slots of `params`, (PARAMETERS,)."""


@dataclass(frozen=True)
class Clamp(Free):
    """Holds at rest whatever is at x <= -wall [m from the object's centre]; the body must stay below x = wall - 3 h."""

    wall: float = math.inf
    mode = "rigid"

    def side(self, x: Array) -> Array:
        """-1 for held particles, (N,) int32."""
        return -np.asarray(x[:, 0] <= 1e-6 - self.wall).astype(np.int32)

    def holding(self, layout: Layout, x: Array) -> Holding:
        """Nodes at x [m], (M, 3), on the wall and behind it."""
        return Holding.by(self.side(x))

    def fill(self, params: Array) -> None:
        """Set in `params`, (PARAMETERS,), two slabs, FAR thick, from the wall outwards."""
        params[SPEED], params[UX : UZ + 1] = 0.0, self.axis
        params[HALF], params[REACH] = FAR + 1e-6, self.wall + FAR
