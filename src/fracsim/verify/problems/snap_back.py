"""A stretched bar released at both ends: a front runs inwards, and the material behind it moves at v."""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import advance, bar, free, medium, put
from fracsim.scene.vocab import Material
from fracsim.verify.closed_form import lateral_stretch, uniaxial
from fracsim.verify.problem import Check, Setting, relative

DENSITY, CELLS = 200.0, 50
ROWS = (("fixed_corotated", 2e3, 0.3, 1.5), ("neo_hookean", 2e4, 0.45, 2.6))


def speed(law: str, E: float, nu: float, stretch: float) -> float:
    """v = sqrt(P (lambda - 1) / rho) [m/s], from the jump conditions of mass and momentum at the front."""
    return float(np.sqrt(E * uniaxial(law, nu, stretch)[0] * (stretch - 1) / DENSITY))


def front(law: str, E: float, nu: float, stretch: float) -> float:
    """Speed of the front in the rest configuration, sqrt(P / ((lambda - 1) rho)) [m/s]."""
    return float(np.sqrt(E * uniaxial(law, nu, stretch)[0] / ((stretch - 1) * DENSITY)))


def run(setting: Setting) -> Iterator[Check]:
    """A bar of 100 x 2 x 2 cells; mean speed of the outer quarter of each half when the front is half-way in."""
    solver = setting.solver(CELLS)
    half = CELLS * solver.h
    for law, E, nu, stretch in ROWS[:1] if setting.quick else ROWS:
        body = bar(solver, (2 * half, 2 * solver.h, 2 * solver.h))
        state = free(medium(solver, Material(law=law, E=E, nu=nu, density=DENSITY)), body)
        F = np.diag([stretch, *[lateral_stretch(law, nu, stretch)] * 2])
        put(state, F=F, U=state.X0 @ (F - np.eye(3)))
        if not state.total:
            state.relayout(state.X0 + state.points.U.to_numpy())
        advance(state, half / 2 / front(law, E, nu, stretch))
        depth = half - np.abs(state.X0[:, 0])
        passed = (depth > 2 * solver.h) & (depth < half / 4)
        v = -float((np.sign(state.X0[:, 0]) * state.points.V.to_numpy()[:, 0])[passed].mean())
        yield relative(f"{law} {nu}, released from {stretch}: v", speed(law, E, nu, stretch), v, 0.05, unit="m/s")
