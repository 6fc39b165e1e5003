"""Two equal blocks that collide on the grid: momentum stays zero, angular momentum stays constant."""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import advance, angular_momentum, free, lattice, medium, momentum, particles, put
from fracsim.mpm.energy import masses
from fracsim.scene.vocab import Material
from fracsim.verify.problem import Check, Setting, absolute, reported

FORMULATIONS = ("updated",)
"""`total` has no contact."""
EDGE, GAP, SPEED = 0.12, 0.08, 1.0
"""Edge of a block [m], gap [m], speed of each [m/s]."""


def run(setting: Setting) -> Iterator[Check]:
    """Blocks of three cells at +-1 m/s, their centres offset by a quarter of the edge."""
    solver = setting.solver(50)
    shift = (EDGE + GAP) / 2
    X = np.concatenate([lattice((EDGE,) * 3, solver.spacing, (1 + k * shift, 1 + k * EDGE / 8, 1.0)) for k in (-1, 1)])
    state = free(medium(solver, Material(law="neo_hookean", E=1e4, nu=0.3)), particles(X, solver.spacing))
    side = np.sign(state.X0[:, 0]).astype(float)
    put(state, V=-SPEED * side[:, None] * np.array([1.0, 0, 0]))
    scale, L = masses(state).sum() * SPEED, angular_momentum(state)
    advance(state, 0.15)
    tolerance = setting.by_precision(1e-5, 1e-12)
    yield absolute("momentum / sum m |v|", 0, float(np.abs(momentum(state)).max() / scale), tolerance)
    drift = np.linalg.norm(angular_momentum(state) - L) / np.linalg.norm(L)
    yield absolute("drift of angular momentum, relative", 0, float(drift), tolerance)
    yield reported("rebound speed / approach speed", float((side * state.points.V.to_numpy()[:, 0]).mean() / SPEED))
