"""A recoil that ends in a shock: compressed as the jump conditions say, without ringing that crushes single cells."""

import numpy as np
import pytest

from fracsim import Material, Solver
from fracsim.lab.stage import advance, clamped, elastic, flat, kinetic, lattice, medium, particles, put
from fracsim.mpm import params as slot
from fracsim.mpm.state import State
from fracsim.records import Array

MU, DENSITY, CELLS, LENGTH = 5e3, 200.0, 100, 0.9
"""Shear modulus [Pa], density [kg/m^3], cells in 2 m, length of the row beside the wall [m]."""


def thrown(stretch: float, safety: float) -> tuple[State, float]:
    """A row of particles, kept straight, that flies at a wall as fast as it takes to be compressed to `stretch`.

    Neo-Hookean with nu = 0: P = mu (l - 1 / l), and a shock from rest to l that stops v leaves
    density v^2 = -P (1 - l).
    """
    solver = Solver(cells=CELLS, damping="none", precision="float64", safety=safety)
    X = lattice((1.0, solver.spacing, solver.spacing), solver.spacing) - np.float32([0.1, 0, 0])
    material = Material(law="neo_hookean", E=2 * MU, nu=0.0, density=DENSITY, viscosity=0.0, decay=0.0)
    state = clamped(medium(solver, material), particles(X, solver.spacing), wall=0.5)
    v = np.sqrt(MU * (1 / stretch - stretch) * (1 - stretch) / DENSITY)
    put(state, V=np.where(state.points.tag.to_numpy()[:, None] == slot.FREE, -v, 0) * [1, 0, 0])
    return state, v


def stretches(state: State) -> Array:
    """Stretch along the row from the wall on, (N,)."""
    free = np.flatnonzero(state.points.tag.to_numpy() == slot.FREE)
    out: Array = state.points.F.to_numpy()[free[np.argsort(state.X0[free, 0])], 0, 0]
    return out


@pytest.mark.parametrize("safety", [0.8, 0.2])
@pytest.mark.parametrize("stretch", [0.5, 0.2])
def test_a_shock_leaves_what_the_jump_conditions_say(stretch: float, safety: float) -> None:
    """Whatever the substep: neither the jump conditions nor the energy, friction included, depend on it."""
    state, v = thrown(stretch, safety)
    before, half = kinetic(state), 0.5 * LENGTH * (1 - stretch) / v  # the shock runs at v / (1 - l) along the row
    for _ in range(20):
        advance(state, half / 20, before=flat(state, (1, 2)))
    l = stretches(state)
    behind = l[len(l) // 10 : len(l) * 3 // 8]
    # Measured: mean within 1 %, what is left of the ringing 11 % of it. Without shock viscosity at a stretch of 0.2 the
    # mean is off by half, and particles are inverted.
    assert behind.mean() == pytest.approx(stretch, rel=0.02)
    assert behind.std() < 0.15 * stretch
    assert l.min() > stretch / 2
    kept = kinetic(state) + elastic(state) + float(state.sums()[slot.VISCOUS] + state.sums()[slot.PROJECTED])
    assert kept == pytest.approx(before, rel=0.02)


def test_a_smooth_compression_meets_no_friction_to_speak_of() -> None:
    """The pressure is quadratic in the rate: h = L / 40 and v / c = 0.1 make 1.5 (v h / (L c))^2 = 1e-5 of E."""
    state, v = thrown(0.9, 0.8)
    put(state, V=np.minimum(0, -v * (state.X0[:, :1] + 0.5) / LENGTH) * [1, 0, 0])
    before = kinetic(state)
    advance(state, 0.2 * LENGTH / np.sqrt(2 * MU / DENSITY), before=flat(state, (1, 2)))
    assert float(state.sums()[slot.VISCOUS]) < 1e-3 * before
