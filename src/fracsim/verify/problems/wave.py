"""Two halves of a bar pulled apart: a tension step of height rho c v0 runs outwards at c = sqrt(E / rho).

Waves of a few cells lag behind: omega = c k (1 - DISPERSION (k h)^2). A step then becomes 1/3 + the integral of Airy's
function, which reaches half its height HALF (3 DISPERSION n)^(1/3) cells late after n cells (Whitham 1974).
"""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import advance, flat, put, row
from fracsim.records import Array
from fracsim.scene.vocab import Material
from fracsim.verify.problem import Check, Setting, relative, reported

E, DENSITY, LENGTH, RATIO = 2e3, 200.0, 1.0, 0.01
"""Modulus [Pa], density [kg/m^3], length of a half [m], v0 / c."""
C = np.sqrt(E / DENSITY)
COURANT = 0.4
"""c dt / h."""
DISPERSION = 0.101
"""That of a row with two particles a cell, from its Bloch waves at this COURANT."""
HALF = 0.4096
"""Where Airy's function has half its integral, from -HALF on."""


def stress(x: Array, t: float) -> Array:
    """Axial Kirchhoff stress P F [Pa], (N,), at distances x (N,) [m] from the middle, before the front is at an end."""
    return np.where(np.abs(x) < C * t, DENSITY * C * RATIO * C * (1 + RATIO), 0.0)


def late(cells: float) -> float:
    """By how much the front is late at half height after some cells, relative."""
    return float(HALF * (3 * DISPERSION * cells) ** (1 / 3) / cells)


def measure(setting: Setting, cells: int) -> tuple[float, Array, Array]:
    """A place [m] half-way along a half, times [s], (T,), and axial stresses there [Pa], (T,)."""
    solver = setting.solver(2 * cells)
    x = (np.arange(4 * cells) + 0.5) * solver.h / 2 - LENGTH
    state = row(solver, Material(E=E, nu=0.0, density=DENSITY), x)
    put(state, V=RATIO * C * np.sign(x)[:, None] * [1, 0, 0])
    at = int(np.abs(x - LENGTH / 2).argmin())
    dt, steps = COURANT * solver.h / C, int(1.4 * cells / COURANT)
    stresses = [0.0]
    for k in range(steps):
        advance(state, dt, k * dt, flat(state, (1, 2)))
        stresses.append(float(state.observe()[0][at, 0, 0]))
    return float(x[at]), dt * np.arange(len(stresses)), np.array(stresses)


def run(setting: Setting) -> Iterator[Check]:
    """Arrival of half the step's height, the plateau until the front returns, and the overshoot."""
    for cells in (25, 50) if setting.quick else (25, 50, 100):
        x, t, s = measure(setting, cells)
        height = float(stress(np.array(x), 2 * LENGTH / C))
        k = int(np.flatnonzero(s > height / 2)[0])
        arrival = t[k - 1] + (height / 2 - s[k - 1]) / (s[k] - s[k - 1]) * (t[k] - t[k - 1])
        target = late(x / LENGTH * cells) if cells == 100 else None
        yield relative(f"arrival at half height, {cells} cells", x / C, float(arrival), target, unit="s", axis="h",
                       at=LENGTH / cells)  # fmt: skip
    plateau = s[(t > 0.7 * LENGTH / C) & (t < 1.3 * LENGTH / C)]
    yield relative("plateau stress", height, float(plateau.mean()), 0.005, unit="Pa")
    yield reported("overshoot / plateau", float(s.max() / height - 1))
