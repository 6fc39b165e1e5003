"""A free block on a grid whose velocity decays at a rate: v(t) = v0 exp(-rate t)."""

import math
from collections.abc import Iterator

from fracsim.lab.stage import free, lattice, medium, ordered, particles, put
from fracsim.scene.vocab import DT0, Material
from fracsim.verify.problem import Check, Setting, relative

RATE, DURATION, SUBSTEPS = 5.0012504, 1.0, 2000
"""Rate [1/s], the paper's g = 0.9995 in a substep of 1e-4 s; duration [s]; substeps."""


def speed(mode: str, substeps: int, dt: float) -> float:
    """Remaining part of the initial velocity after `substeps` of dt [s]; `mode` is solver.damping."""
    step = {"physical": dt, "per_substep": DT0, "none": 0.0}[mode]
    return math.exp(-RATE * step * substeps)


def run(setting: Setting) -> Iterator[Check]:
    """After 1 s about 0.7 % of the velocity remains."""
    solver = setting.solver(50)
    X = ordered(lattice((0.16,) * 3, solver.spacing), solver.h)
    state = free(medium(solver, Material(law="neo_hookean", E=1e4, nu=0.3, decay=RATE)), particles(X, solver.spacing))
    put(state, V=[0.02, 0.0, 0.0])
    state.run(SUBSTEPS, DURATION / SUBSTEPS, 0.0)
    left = float(state.points.V.to_numpy()[:, 0].astype(float).mean() / 0.02)
    yield relative("v(1 s) / v0", speed(solver.damping, SUBSTEPS, DURATION / SUBSTEPS), left,
                   setting.by_precision(1e-4, 1e-10))  # fmt: skip
