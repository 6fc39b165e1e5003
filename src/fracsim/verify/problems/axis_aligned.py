"""A manufactured standing wave along all three axes at once (Wallstedt and Guilkey 2008; Sadeghirad et al. 2011).

u_i = A sin(2 pi X_i) sin(c pi t + phi_i) in a neo-Hookean cube of 1 m, driven by a body force. By symmetry one octant
suffices, surrounded by three cells of mirrored ghosts. Functions of X take positions [m], (N, 3), and t [s].
"""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from fracsim.lab.stage import Ghosts, advance, free, medium, particles, put
from fracsim.mpm.layout import order
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.scene.vocab import CENTRE, Material
from fracsim.verify.problem import Check, Setting, at_least, reported

E, NU, DENSITY, AMPLITUDE, SIZE, DURATION = 2e3, 0.3, 200.0, 0.05, 0.5, 0.25
"""Modulus [Pa], Poisson's ratio, density [kg/m^3], amplitude [m], edge of the octant [m], duration [periods]."""
WAVE = np.sqrt(E / DENSITY)
PHASE = np.array([0.0, np.pi, 0.0])
MATERIAL = Material(law="neo_hookean", E=E, nu=NU, density=DENSITY)
COURANTS = (0.25, 0.125)
"""Values of c dt / h, stable at all stretches of the wave. dt is constant: after a change velocities would no longer be
midway between displacements. There are two values, since the losses of the transfers grow as 1 / dt."""
GHOSTS = 3
"""Cells of ghosts on each side. Particles inside use nodes up to 1 cell outside, these particles up to 2.5 cells."""


def displacement(X: Array, t: float) -> Array:
    """u [m], (N, 3), at X (N, 3)."""
    return np.asarray(AMPLITUDE * np.sin(2 * np.pi * X) * np.sin(WAVE * np.pi * t + PHASE))


def velocity(X: Array, t: float) -> Array:
    """du/dt [m/s], (N, 3), at X (N, 3)."""
    return np.asarray(AMPLITUDE * WAVE * np.pi * np.sin(2 * np.pi * X) * np.cos(WAVE * np.pi * t + PHASE))


def stretches(X: Array, t: float) -> Array:
    """The diagonal of F, (N, 3), at X (N, 3)."""
    return np.asarray(1 + 2 * np.pi * AMPLITUDE * np.cos(2 * np.pi * X) * np.sin(WAVE * np.pi * t + PHASE))


def body_force(X: Array, t: float) -> Array:
    """b = d2u/dt2 - Div P / rho [m/s^2], (N, 3), at X (N, 3); P_ii = mu F_ii + (lam ln J - mu) / F_ii."""
    F = stretches(X, t)
    log_J = np.log(F).sum(axis=1, keepdims=True)
    stiff = MATERIAL.mu - (MATERIAL.lam * (log_J - 1) - MATERIAL.mu) / F**2
    return np.asarray(np.pi**2 * displacement(X, t) * (4 * stiff / DENSITY - WAVE**2))


def octant(
    setting: Setting, cells: int, courant: float | None = None, per_axis: float = 2
) -> tuple[State, Array, Ghosts, Array]:
    """The octant at t = 0, with `cells` cells and `per_axis` particles a cell and axis along 1 m.

    Returns its state, positions X (N, 3) [m] from its corner, its ghosts, and whether a particle is not a ghost, (N,).
    """
    solver = setting.solver(2 * cells, per_axis)
    if courant:
        solver.dt = courant * solver.h / float(WAVE)
    n, pad = round(SIZE / solver.spacing), round(GHOSTS * solver.h / solver.spacing)
    grid = np.stack(np.meshgrid(*[np.arange(-pad, n + pad)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    grid = grid[order(grid * (solver.spacing / solver.h) + 100.25)]
    X = (grid + 0.5) * solver.spacing
    place = X - SIZE / 2 + CENTRE
    state = free(medium(solver, MATERIAL), particles(place, solver.spacing))
    folded = np.where(grid < 0, -1 - grid, np.where(grid >= n, 2 * n - 1 - grid, grid))
    sign, ghost = np.where(folded == grid, 1.0, -1.0), np.flatnonzero((folded != grid).any(axis=1))
    where = np.full((n + 2 * pad,) * 3, -1)
    where[tuple(grid.T + pad)] = np.arange(len(grid))
    ghosts = Ghosts(ghost, where[tuple(folded[ghost].T + pad)], sign[ghost])
    slope = 2 * np.pi * AMPLITUDE * WAVE * np.pi * np.cos(2 * np.pi * X) * np.cos(PHASE)
    put(state, V=velocity(X, 0.0), C=slope[:, :, None] * np.eye(3))
    own = np.ones(len(X), bool)
    own[ghost] = False
    return state, X, ghosts, own


def clock(state: State, spent: list[float]) -> None:
    """Let each later call of `state.run` append its processor time [s] to `spent`."""
    run = state.run

    def timed(*arguments: Any) -> int:
        start = time.process_time()
        steps = run(*arguments)
        spent.append(time.process_time() - start)
        return steps

    state.run = timed  # type: ignore[method-assign, assignment]


def error(
    setting: Setting, cells: int, courant: float | None = None, per_axis: float = 2, spent: list[float] | None = None
) -> float:
    """Largest error of the displacement after DURATION, relative to AMPLITUDE.

    The processor time [s] of each substep is appended to `spent`.
    """
    state, X, ghosts, own = octant(setting, cells, courant, per_axis)

    def before(t: float, dt: float) -> None:
        put(state, force=body_force(X, t))
        ghosts(state)

    end = DURATION * 2 / WAVE
    if spent is not None:
        clock(state, spent)
    advance(state, end, before=before)
    wrong = state.points.U.to_numpy().astype(float) - displacement(X, end)
    return float(np.abs(wrong[own]).max() / AMPLITUDE)


def run(setting: Setting) -> Iterator[Check]:
    """8, 16 and 32 cells a wavelength at two Courant numbers; the finest also with the preset's dt."""
    sizes = (8, 16) if setting.quick else (8, 16, 32)
    for courant in COURANTS:
        errors = []
        for cells in sizes:
            errors.append(error(setting, cells, courant))
            yield Check(f"largest error of u / A, c dt / h = {courant}, {cells} cells", 0, errors[-1], errors[-1],
                        axis="h", at=1 / cells)  # fmt: skip
        found = float(np.log2(errors[-2] / errors[-1]))
        name = f"order at c dt / h = {courant}, {sizes[-2]} to {sizes[-1]} cells"
        yield reported(name, found) if setting.quick else at_least(name, 1.8, found)
    wrong = error(setting, sizes[-1])
    yield Check(f"largest error of u / A with the preset's dt: {sizes[-1]} cells", 0, wrong, wrong)
