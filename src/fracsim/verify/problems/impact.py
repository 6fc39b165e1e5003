"""Two equal bars that meet end to end: they touch for 2 L / c and swap their velocities.

Without lateral coupling the nominal stress of the fixed corotated law is linear, so this holds at any speed.
"""

from collections.abc import Iterator

import numpy as np

from fracsim.verify.problem import Check, Setting, relative
from fracsim.verify.stage import advance, free, particles, put, scene
from fracsim.vocab import Material

FORMULATIONS = ("updated",)
"""`total` has no contact."""
E, DENSITY, LENGTH, RATIO = 2e3, 200.0, 1.0, 0.1
"""Modulus [Pa], density [kg/m^3], length of a bar [m], v0 / c."""
C = np.sqrt(E / DENSITY)


def contact_time() -> float:
    """Until the waves are back from the far ends [s]."""
    return float(2 * LENGTH / C)


def run(setting: Setting) -> Iterator[Check]:
    """The mean velocity of a bar falls evenly from v0 to -v0 while they touch."""
    cells = 25 if setting.quick else 50
    solver = setting.solver(2 * cells)
    half = (np.arange(2 * cells) + 0.5) * solver.h / 2
    x = np.concatenate([-half[::-1], half]) + np.repeat([-1, 1], 2 * cells) * solver.h
    X = np.stack([1 + x, np.ones_like(x), np.ones_like(x)], axis=1)
    state = free(scene(solver, Material(E=E, nu=0.0, density=DENSITY), X), particles(X, solver.h / 2))
    v0 = RATIO * C
    put(state, V=-v0 * np.sign(x)[:, None] * [1, 0, 0])
    dt, mean = LENGTH / C / 50, [v0]
    for k in range(int((contact_time() + 3 * solver.h / v0) / dt)):
        advance(state, dt, k * dt)
        mean.append(-float(state.V.to_numpy()[x > 0, 0].mean()))
    v, t = np.array(mean) / v0, dt * np.arange(len(mean))
    found = (np.interp(0.8, -v, t) - np.interp(-0.8, -v, t)) / 0.8 if v.min() < -0.8 else np.nan
    yield relative(f"contact time, {cells} cells", contact_time(), float(found), 0.02, unit="s")
    yield relative("rebound velocity / v0", -1, float(v[-1]), 0.02)
