"""A block that flies 100 cells: only its position changes."""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import advance, free, lattice, medium, momentum, ordered, particles, put
from fracsim.records import Array
from fracsim.scene.vocab import Material
from fracsim.verify.problem import Check, Setting, absolute, relative

VELOCITY = np.array([5.0, 2.0, -1.0])
CELLS = 100
"""Cells flown."""
STRAIN = 4 * CELLS * 2.0**-24
"""Largest |F - I| in float32. Velocities of nodes are off by two roundings, their own and that of the projection. The
rate C = 4 / h^2 sum w (x_i - x_p) v_i takes them by up to 4 / h^2 h / 2, so that each cell flown adds 4 roundings."""


def displacement(t: float) -> Array:
    """Displacement [m], (3,), of all particles at t [s]."""
    return VELOCITY * t


def run(setting: Setting) -> Iterator[Check]:
    """F, v and momentum stay constant to round-off; the distance is v t."""
    solver = setting.solver(50)
    X = ordered(lattice((0.16,) * 3, solver.spacing), solver.h)
    state = free(medium(solver, Material(law="neo_hookean", E=1e4, nu=0.3)), particles(X, solver.spacing))
    put(state, V=VELOCITY)
    before, t = momentum(state), CELLS * solver.h / np.linalg.norm(VELOCITY)
    advance(state, t)
    strain, drift = (
        np.abs(state.points.F.to_numpy() - np.eye(3)).max(),
        np.abs(state.points.V.to_numpy() - VELOCITY).max(),
    )
    yield absolute("largest |F - I|", 0, float(strain), setting.by_precision(STRAIN, 1e-12))
    yield absolute("largest |v - v0| / |v0|", 0, float(drift / np.linalg.norm(VELOCITY)),
                   setting.by_precision(1e-5, 1e-12))  # fmt: skip
    change = np.linalg.norm(momentum(state) - before) / np.linalg.norm(before)
    yield absolute("change of momentum, relative", 0, float(change), setting.by_precision(1e-5, 1e-12))
    mean = state.points.U.to_numpy().astype(float).mean(axis=0)
    yield relative("distance flown", float(np.linalg.norm(displacement(t))), float(np.linalg.norm(mean)),
                   setting.by_precision(1e-5, 1e-10), unit="m")  # fmt: skip
