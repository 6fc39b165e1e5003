"""Two halves of a bar that fly apart: a step of tension runs outwards at c = sqrt(E / rho), its height rho c v0."""

from collections.abc import Iterator

import numpy as np

from fracsim.records import Array
from fracsim.verify.problem import Check, Setting, relative, told
from fracsim.verify.stage import advance, free, particles, put, scene
from fracsim.vocab import Material

E, DENSITY, LENGTH, RATIO = 2e3, 200.0, 1.0, 0.01
"""Modulus [Pa], density [kg/m^3], length of a half [m], v0 / c."""
C = np.sqrt(E / DENSITY)


def stress(x: Array, t: float) -> Array:
    """Axial stress at x [m from the middle] before the front meets an end [Pa]."""
    return np.where(np.abs(x) < C * t, DENSITY * C * RATIO * C, 0.0)


def run(setting: Setting) -> Iterator[Check]:
    """The stress half-way along a half, at each substep."""
    cells = 50 if setting.quick else 100
    solver = setting.solver(2 * cells)
    x = (np.arange(4 * cells) + 0.5) * solver.h / 2 - LENGTH
    X = np.stack([1 + x, np.ones_like(x), np.ones_like(x)], axis=1)
    state = free(scene(solver, Material(E=E, nu=0.0, density=DENSITY), X), particles(X, solver.h / 2))
    put(state, V=RATIO * C * np.sign(x)[:, None] * [1, 0, 0])
    at = int(np.abs(x - LENGTH / 2).argmin())
    dt, steps = 0.4 * solver.h / C, int(1.4 * cells / 0.4)
    seen = [0.0]
    for k in range(steps):
        advance(state, dt, k * dt)
        seen.append(float(state.observe()[0][at, 0, 0]))
    height, s = float(stress(x[at], 2 * LENGTH / C)), np.array(seen)
    k = int(np.flatnonzero(s > height / 2)[0])
    arrival = (k - 1 + (height / 2 - s[k - 1]) / (s[k] - s[k - 1])) * dt
    # Within a cell of the front the step is not resolved.
    yield relative(f"arrival at half height, {cells} cells", x[at] / C, arrival, 0.01, unit="s")
    t = dt * np.arange(len(s))
    plateau = s[(t > 0.7 * LENGTH / C) & (t < 1.3 * LENGTH / C)]
    yield relative("plateau stress", height, float(plateau.mean()), 0.01, unit="Pa")
    yield told("overshoot / plateau", float(s.max() / height - 1))
