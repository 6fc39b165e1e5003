"""First axial mode of a bar with a fixed and a free end: period, energy, and order of the error.

The fixed end is the middle of a symmetric bar of twice the length.
"""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import advance, elastic, flat, kinetic, put, row
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.scene.vocab import Material
from fracsim.verify.problem import Check, Setting, absolute, at_least, relative

E, DENSITY, LENGTH, AMPLITUDE, PERIODS = 2e3, 200.0, 1.0, 0.01, 5
"""Modulus [Pa], density [kg/m^3], length of a half [m], initial velocity of its end / wave speed, number of periods."""
C = np.sqrt(E / DENSITY)
PERIOD = 4 * LENGTH / C


def velocity(x: Array, t: float) -> Array:
    """Axial velocity [m/s], (N,), at distances x (N,) [m] from the fixed end."""
    v: Array = AMPLITUDE * C * np.sin(np.pi * x / (2 * LENGTH)) * np.cos(2 * np.pi * t / PERIOD)
    return v


def ringing(setting: Setting, cells: int) -> State:
    """The bar in its first mode, with two particles a cell."""
    solver = setting.solver(2 * cells)
    x = (np.arange(4 * cells) + 0.5) * solver.h / 2 - LENGTH
    state = row(solver, Material(E=E, nu=0.0, density=DENSITY), x)
    slope = AMPLITUDE * C * np.pi / (2 * LENGTH) * np.cos(np.pi * x / (2 * LENGTH))
    put(state, V=velocity(x, 0)[:, None] * [1, 0, 0], C=slope[:, None, None] * np.diag([1, 0, 0]))
    return state


def measure(state: State) -> tuple[float, float]:
    """Period [s], from the zeros of the mean velocity of one half, and the part of the energy left after PERIODS."""
    first, dt, half = kinetic(state), PERIOD / 100, state.X0[:, 0] > 0
    mean = [float(state.points.V.to_numpy()[half, 0].mean())]
    for k in range(100 * PERIODS):
        advance(state, dt, k * dt, flat(state, (1, 2)))
        mean.append(float(state.points.V.to_numpy()[half, 0].mean()))
    v = np.array(mean)
    at = np.flatnonzero(v[:-1] * v[1:] < 0)
    zeros = (at + v[at] / (v[at] - v[at + 1])) * dt
    period = 2 * float(np.polyfit(np.arange(len(zeros)), zeros, 1)[0])
    return period, (kinetic(state) + elastic(state)) / first


def run(setting: Setting) -> Iterator[Check]:
    """13, 25, 50 and 100 cells along a half."""
    sizes = (13, 25) if setting.quick else (13, 25, 50, 100)
    errors = []
    targets = {13: (0.02, 0.06), 25: (0.01, 0.02), 50: (0.005, 0.005), 100: (0.0025, 0.0015)}
    for cells in sizes:
        period, energy = measure(ringing(setting, cells))
        at = {"axis": "h", "at": LENGTH / cells}
        check = relative(f"period, {cells} cells", PERIOD, period, targets[cells][0], unit="s", **at)
        errors.append(check.error)
        yield check
        yield absolute(f"energy left after {PERIODS} periods, {cells} cells", 1, energy, targets[cells][1], **at)
    order = np.log(errors[0] / errors[-1]) / np.log(sizes[-1] / sizes[0])
    yield at_least("order of the period", 1.8, float(order))
