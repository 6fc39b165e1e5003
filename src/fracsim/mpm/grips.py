"""The two grips: who is held by them, and what it costs to move it."""

from dataclasses import dataclass

import numpy as np
import taichi as ti

from fracsim.mpm.ends import end
from fracsim.mpm.layout import Layout
from fracsim.mpm.params import (
    EXEMPT,
    FREE,
    GRIP_WORK,
    HALF,
    PULL_HIGH,
    PULL_LOW,
    SPEED,
    UX,
    UY,
    UZ,
)  # fmt: skip
from fracsim.mpm.tally import tally
from fracsim.records import Array
from fracsim.scene.vocab import CENTRE, Loading, Scene

BESIDE = 1.5
"""Material this near to what a grip moves [cells] is stretched more than that further away, by up to a third."""
TIED = 2
"""Times the grip, -1 or +1: the owner of a node that is moved together with the one that it is tied to."""


def along(loading: Loading, X: Array) -> Array:
    """Distance of points from the object's centre along the tearing axis [m], (N,) float64."""
    return (X.astype(np.float64) - CENTRE) @ np.asarray(loading.axis)


def tags(scene: Scene, X: Array) -> Array:
    """Tag of each particle: which grip holds it, and whether it is exempt from damage, (N,) int32.

    Raises ValueError naming the grip that holds no particle.
    """
    load, s = scene.loading, along(scene.loading, X)
    side = (np.abs(s - load.offset) <= load.thickness / 2).astype(np.int32)
    side -= np.abs(s + load.offset) <= load.thickness / 2
    for sign, name in ((-1, "lower"), (1, "upper")):
        if not (side == sign).any():
            reach = f"the object spans {s.min():.3g}..{s.max():.3g} m along loading.axis_deg={load.axis_deg:g}"
            raise ValueError(
                f"loading.offset={load.offset:g}: the {name} grip holds no particle ({reach}). "
                "Choose a smaller loading.offset, a larger loading.thickness or another axis."
            )
    low, high = moved(scene)
    near = (low - BESIDE * scene.solver.h <= np.abs(s)) & (np.abs(s) <= high + BESIDE * scene.solver.h)
    exempt = near & (not scene.fracture.at_grips)
    return (side + FREE + EXEMPT * exempt).astype(np.int32)


def moved(scene: Scene) -> tuple[float, float]:
    """Between which distances from the object's centre [m] a grip moves particles or nodes at rest."""
    load, h, along = scene.loading, scene.solver.h, max(np.abs(scene.loading.axis))
    low, high = load.offset - load.thickness / 2, load.offset + load.thickness / 2
    if load.grips == "soft":
        return low, high
    reach = (end(along).soft + along) * h
    low, high = low - reach, high + reach
    if along == 1:  # the planes of nodes are known
        low, high = h * np.ceil(low / h), h * np.floor(high / h)
    return low, high


@dataclass(frozen=True)
class Holding:
    """How the grips hold the M nodes near a particle at rest.

    A grip's face lies anywhere between nodes. The node that follows the last one held, the edge, gets shares of the
    velocities of the two behind it, all relative to the grip, so that what is stretched ends at the face, and not up to
    half a cell before or behind it (`fracsim.mpm.ends`). This is a constraint, not a force: it costs no substeps.
    """

    owner: Array
    """The grip, -1 or +1, that each moves with, TIED times that of an edge and of the second node behind it, 0 if it
    is free, (M,) int32."""
    tied: Array
    """The edge before and the node behind each first node behind an edge, or -1, (M, 2) int32."""
    share: Array
    """Shares of this node and of the one behind it, (M, 2) float64."""


NOBODY = Holding(np.zeros(1, np.int32), np.full((1, 2), -1, np.int32), np.zeros((1, 2)))
"""For kernels that don't look."""


def half_reach(scene: Scene) -> float:
    """Nodes this near to a grip's middle plane move with it [m] where there are no edges: right on average."""
    hung = end(max(np.abs(scene.loading.axis)))
    return scene.loading.thickness / 2 + (hung.soft + hung.pitch / 2) * scene.solver.h


def holding(scene: Scene, grid: Layout, x: Array) -> Holding:
    """How grips hold the nodes of a layout, which lie at x [m from the object's centre] at rest, (M, 3)."""
    load, axis = scene.loading, np.asarray(scene.loading.axis)
    k, s = int(np.abs(axis).argmax()), x @ axis
    hung = end(abs(axis[k]))
    side, outside = np.sign(s), np.abs(s) - load.offset
    gap = (np.abs(outside) - load.thickness / 2) / scene.solver.h - hung.soft
    edge = np.flatnonzero((gap > 0) & (gap <= hung.pitch))
    way = (side * np.sign(outside) * np.sign(axis[k]))[edge]
    first = grid.beside(edge, k, way)
    second = np.where(first < 0, -1, grid.beside(first, k, way))
    once = np.bincount(np.concatenate([first, second]) + 1) == 1
    fit = (second >= 0) & (gap[first] > hung.pitch) & (gap[second] > hung.pitch) & once[first + 1] & once[second + 1]
    owner = side * (gap <= 0)
    owner[edge] = side[edge] * np.where(fit, TIED, gap[edge] <= hung.pitch / 2)
    edge, first, second = edge[fit], first[fit], second[fit]
    owner[second] = TIED * side[edge]  # which side of the centre a node is on doesn't matter
    tied, share = np.full((len(x), 2), -1, np.int32), np.zeros((len(x), 2))
    tied[first] = np.stack([edge, second], axis=1)
    share[first] = hung.shares(gap[edge])
    return Holding(owner.astype(np.int32), tied, share)


@ti.func
def grip_of_node(x, middle, K: ti.template()):
    """-1, 0 or +1 for a node at x [m from the object's centre] and slabs whose middle planes are at +-middle."""
    s = x[0] * K[UX] + x[1] * K[UY] + x[2] * K[UZ]
    grip = 0
    if ti.abs(ti.abs(s) - middle) <= K[HALF]:
        grip = 1 if s > 0 else -1
    return grip


@ti.func
def hold(ledger: ti.template(), grip, mass, v, K: ti.template(), mode: ti.template()):
    """The velocity that a grip gives to `mass` moving with v; books its impulse and its work."""
    book(ledger, grip, mass * (grip * K[SPEED] - v.dot(ti.Vector([K[UX], K[UY], K[UZ]]))), K)
    return led(grip, v, K, mode)


@ti.func
def book(ledger: ti.template(), grip, impulse, K: ti.template()):
    """Books an impulse of a grip along the axis [kg m/s]."""
    slot = PULL_LOW
    if grip > 0:
        slot = PULL_HIGH
    tally(ledger, slot, impulse)
    tally(ledger, GRIP_WORK, impulse * grip * K[SPEED])


@ti.func
def tie(ledger: ti.template(), grip, near, far, e, v, b, mass, K: ti.template(), mode: ti.template()):
    """The impulse on an edge after which e = near v + far b, all relative to the grip; -near and -far times it act on
    the two nodes behind it, by which the kinetic energy changes least. `mass` is that of the three."""
    u = ti.Vector([K[UX], K[UY], K[UZ]])
    drive = (grip * K[SPEED]) * u
    short = near * (v - drive) + far * (b - drive) - (e - drive)
    if ti.static(mode == "sliding"):
        short = short.dot(u) * u
    impulse = short / (1 / mass[0] + near * near / mass[1] + far * far / mass[2])
    book(ledger, grip, (1 - near - far) * impulse.dot(u), K)
    return impulse


@ti.func
def led(grip, v, K: ti.template(), mode: ti.template()):
    """The velocity with which a grip leads what would move with v."""
    u = ti.Vector([K[UX], K[UY], K[UZ]])
    along = grip * K[SPEED]
    return v + (along - v.dot(u)) * u if ti.static(mode == "sliding") else along * u
