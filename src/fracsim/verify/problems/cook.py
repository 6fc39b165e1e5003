"""Cook's membrane in plane strain (Cook 1974), compressible and nearly incompressible, under a small shear load.

The reference is a converged solution by nine-node finite elements.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fracsim.lab.stage import advance, clamped, flat, medium, particles, put, slow
from fracsim.mpm.energy import masses
from fracsim.mpm.layout import order
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.scene.vocab import Material
from fracsim.verify.elements import edge_deflection
from fracsim.verify.problem import Check, Setting, relative, reported

CORNERS = np.array([[0.0, 0.0], [0.48, 0.44], [0.48, 0.60], [0.0, 0.44]])
"""Counter-clockwise [m]; the left edge is held."""
E, DENSITY, LOAD = 2e3, 200.0, 1e-3
"""Modulus [Pa], density [kg/m^3], shear traction on the right edge / E."""
RATIOS = (0.3, 0.49, 0.499)
SLOWEST = 6.19 * 0.48**2 / 0.30 / np.sqrt(E / DENSITY)
"""Period [s] of a cantilever of the membrane's mean depth. With critical damping it is at rest after two periods."""
HELD = 2
"""Length of the membrane inside the wall [cells]."""


def sag(nu: float, elements: int = 64) -> float:
    """Mean u_y of the right edge [m] by `elements`^2 finite elements."""
    return LOAD * edge_deflection(CORNERS, nu, elements)


def membrane(setting: Setting, nu: float, cells: int) -> State:
    """One layer of particles in columns between the slanted edges, `cells` cells along the length."""
    solver = setting.solver(2 * cells / 0.48)
    h, s = solver.h, solver.spacing
    x, part = (a.ravel() for a in np.meshgrid(np.arange(-HELD * h + s / 2, 0.48, s), _middles(round(0.44 / s)),
                                              indexing="ij"))  # fmt: skip
    low, high = np.maximum(x, 0) * 0.44 / 0.48, 0.44 + np.maximum(x, 0) * 0.16 / 0.48
    wall = h * np.ceil((0.48 / h + 5) / 2)
    X = np.stack([x - wall + 1, low + part * (high - low) - 10 * h + 1, np.ones_like(x)], axis=1)
    by = order((X - 1) / h)
    body = particles(X[by], s)
    body = replace(body, volume=((high - low) / 0.44 * s**3)[by].astype(np.float32))
    return clamped(medium(solver, Material(law="neo_hookean", E=E, nu=nu, density=DENSITY)), body, wall)


def _middles(n: int) -> Array:
    """Middles of n equal parts of [0, 1], (n,)."""
    return (np.arange(n) + 0.5) / n


def settle(state: State) -> float:
    """Load the last column of particles, damp the motion; returns the column's mean u_y at rest [m]."""
    h, x = state.medium.h, state.X0[:, 0]
    tip = x > x.max() - h / 4
    pull = np.zeros((state.n, 3))
    pull[tip, 1] = LOAD * E * 0.16 * (h / 2) / masses(state)[tip].sum()
    rate, flatten = 4 * np.pi / SLOWEST, flat(state, (2,))

    def before(t: float, dt: float) -> None:
        slow(state, np.exp(-rate * dt))
        flatten(t, dt)

    put(state, force=pull)
    advance(state, 2 * SLOWEST, before=before)
    return float(state.points.U.to_numpy()[tip, 1].mean())


def run(setting: Setting) -> Iterator[Check]:
    """8, 16 and 32 cells along the length, for three Poisson's ratios."""
    for nu in RATIOS[:2] if setting.quick else RATIOS:
        exact = sag(nu)
        yield reported(f"nu = {nu}, change of the reference on 32 x 32 elements", sag(nu, 32) / exact - 1)
        for cells in (8,) if setting.quick else (8, 16, 32):
            target = 0.05 if cells == 32 else None
            yield relative(f"nu = {nu}, sag of the right edge, {cells} cells", exact,
                           settle(membrane(setting, nu, cells)), target, unit="m", axis="h",
                           at=0.48 / cells)  # fmt: skip
