"""Two halves of a bar pulled apart: a tension step of height rho c v0 runs outwards at c = sqrt(E / rho)."""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import advance, flat, put, row
from fracsim.records import Array
from fracsim.scene.vocab import Material
from fracsim.verify.problem import Check, Setting, relative, reported

E, DENSITY, LENGTH, RATIO = 2e3, 200.0, 1.0, 0.01
"""Modulus [Pa], density [kg/m^3], length of a half [m], v0 / c."""
C = np.sqrt(E / DENSITY)


def stress(x: Array, t: float) -> Array:
    """Axial stress [Pa], (N,), at distances x (N,) [m] from the middle, before the front reaches an end."""
    return np.where(np.abs(x) < C * t, DENSITY * C * RATIO * C, 0.0)


def measure(setting: Setting, cells: int) -> tuple[float, Array, Array]:
    """A place [m] half-way along a half, times [s], (T,), and axial stresses there [Pa], (T,)."""
    solver = setting.solver(2 * cells)
    x = (np.arange(4 * cells) + 0.5) * solver.h / 2 - LENGTH
    state = row(solver, Material(E=E, nu=0.0, density=DENSITY), x)
    put(state, V=RATIO * C * np.sign(x)[:, None] * [1, 0, 0])
    at = int(np.abs(x - LENGTH / 2).argmin())
    dt, steps = 0.4 * solver.h / C, int(1.4 * cells / 0.4)
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
        target = 0.01 if cells == 100 else None
        yield relative(f"arrival at half height, {cells} cells", x / C, float(arrival), target, unit="s", axis="h",
                       at=LENGTH / cells)  # fmt: skip
    plateau = s[(t > 0.7 * LENGTH / C) & (t < 1.3 * LENGTH / C)]
    yield relative("plateau stress", height, float(plateau.mean()), 0.01, unit="Pa")
    yield reported("overshoot / plateau", float(s.max() / height - 1))
