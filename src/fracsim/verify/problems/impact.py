"""Two equal bars that collide end to end: they touch for 2 L / c and swap their velocities.

Without lateral coupling the nominal stress of the fixed corotated law is linear, so that this holds at any speed.
"""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import advance, flat, put, row
from fracsim.records import Array
from fracsim.scene.vocab import Material
from fracsim.verify.problem import Check, Setting, relative

FORMULATIONS = ("updated",)
"""`total` has no contact."""
E, DENSITY, LENGTH, RATIO = 2e3, 200.0, 1.0, 0.1
"""Modulus [Pa], density [kg/m^3], length of a bar [m], v0 / c."""
C = np.sqrt(E / DENSITY)


def contact_time() -> float:
    """Time [s] until the waves return from the far ends."""
    return float(2 * LENGTH / C)


def measure(setting: Setting, cells: int) -> tuple[Array, Array]:
    """Times [s], (T,), and mean velocities of one bar / v0, (T,), from a gap of two cells until long after contact."""
    solver = setting.solver(2 * cells)
    half = (np.arange(2 * cells) + 0.5) * solver.h / 2
    x = np.concatenate([-half[::-1], half]) + np.repeat([-1, 1], 2 * cells) * solver.h
    state, v0 = row(solver, Material(E=E, nu=0.0, density=DENSITY), x), RATIO * C
    put(state, V=-v0 * np.sign(x)[:, None] * [1, 0, 0])
    dt, mean = LENGTH / C / 50, [1.0]
    for k in range(int((contact_time() + 6 * solver.h / v0) / dt)):
        advance(state, dt, k * dt, flat(state, (1, 2)))
        mean.append(-float(state.points.V.to_numpy()[x > 0, 0].mean()) / v0)
    return dt * np.arange(len(mean)), np.array(mean)


def run(setting: Setting) -> Iterator[Check]:
    """Contact time and rebound velocity. During contact the mean velocity of a bar falls linearly from v0 to -v0."""
    for cells in (25,) if setting.quick else (25, 50, 100):
        t, v = measure(setting, cells)
        at, last = {"axis": "h", "at": LENGTH / cells}, int(v.argmin()) + 1
        target = 0.02 if cells >= 50 else None
        touching = float(np.interp(0.8, -v[:last], t[:last]) - np.interp(-0.8, -v[:last], t[:last])) / 0.8
        found = touching if v.min() < -0.8 else np.nan
        yield relative(f"contact time, {cells} cells", contact_time(), found, target, unit="s", **at)
        yield relative(f"rebound velocity / v0, {cells} cells", -1, float(v[-1]), target, **at)
