"""The two grips: who is held by them, and what it costs to move it."""

import numpy as np
import taichi as ti

from fracsim.mpm.books import tally
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
from fracsim.records import Array
from fracsim.vocab import CENTRE, Loading, Scene


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
    near = np.abs(np.abs(s) - load.offset) <= load.thickness / 2 + 1.5 * scene.solver.h
    exempt = near & (not scene.fracture.at_grips)
    return (side + FREE + EXEMPT * exempt).astype(np.int32)


def half_reach(scene: Scene) -> float:
    """Nodes this near to a grip's middle plane move with it [m]: on average they end at the grip's face."""
    return scene.loading.thickness / 2 + scene.solver.h / 2


def owners(scene: Scene, x: Array) -> Array:
    """Which grip, -1, 0 or +1, nodes at x [m from the object's centre] at rest, (M, 3), move with, (M,) int32."""
    s, load = x @ np.asarray(scene.loading.axis), scene.loading
    held = np.abs(np.abs(s) - load.offset) <= half_reach(scene)
    return (np.sign(s) * held).astype(np.int32)


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
    u = ti.Vector([K[UX], K[UY], K[UZ]])
    short = grip * K[SPEED] - v.dot(u)
    slot = PULL_LOW
    if grip > 0:
        slot = PULL_HIGH
    tally(ledger, slot, mass * short)
    tally(ledger, GRIP_WORK, mass * short * grip * K[SPEED])
    return led(grip, v, K, mode)


@ti.func
def led(grip, v, K: ti.template(), mode: ti.template()):
    """The velocity with which a grip leads what would move with v."""
    u = ti.Vector([K[UX], K[UY], K[UZ]])
    along = grip * K[SPEED]
    return v + (along - v.dot(u)) * u if ti.static(mode == "sliding") else along * u
