"""A free block that rotates once: it keeps its angular momentum, its energy and its shape."""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import advance, angular_momentum, free, kinetic, lattice, medium, ordered, particles, put
from fracsim.scene.vocab import Material
from fracsim.verify.problem import Check, Setting, absolute, relative, reported

E, NU, DENSITY, OMEGA, SIZE = 1e4, 0.3, 200.0, 2 * np.pi, 0.12
"""Young's modulus [Pa], Poisson's ratio, density [kg/m^3], rate [rad/s], edge [m]."""


def centrifugal_strain() -> float:
    """Order of the strain at the rim: rho omega^2 R^2 / E, with R half the edge."""
    return DENSITY * OMEGA**2 * (SIZE / 2) ** 2 / E


def run(setting: Setting) -> Iterator[Check]:
    """One rotation, in 1 s, of a block of 3^3 cells."""
    solver = setting.solver(50)
    X = ordered(lattice((SIZE,) * 3, solver.spacing), solver.h)
    state = free(medium(solver, Material(law="neo_hookean", E=E, nu=NU)), particles(X, solver.spacing))
    spin = OMEGA * np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])
    put(state, V=state.X0.astype(float) @ spin.T, C=spin)
    L, energy = angular_momentum(state), kinetic(state)
    advance(state, 1.0)
    drift = np.linalg.norm(angular_momentum(state) - L) / np.linalg.norm(L)
    # In `total` the lever arms are integrated apart from the grid's motion, so that the drift falls with dt.
    yield absolute("drift of angular momentum, relative", 0, float(drift), setting.by_precision(1e-5, 1e-12))
    yield reported("change of kinetic energy, relative", kinetic(state) / energy - 1)
    F = state.points.F.to_numpy().astype(float)
    strain = np.abs(F.transpose(0, 2, 1) @ F - np.eye(3)).mean() / 2
    yield absolute("mean |E_GL|", 0, float(strain), centrifugal_strain())
    turned = np.unwrap([0, np.arctan2(F[:, 1, 0].mean(), F[:, 0, 0].mean())])[1] + 2 * np.pi
    yield relative("angle turned", 2 * np.pi, float(turned), 0.02, unit="rad")
