"""Damage follows the largest stretch, never heals, and takes the stress with it (Eqs. 4 and 5)."""

from typing import Any

import numpy as np
import pytest
import taichi as ti

from fracsim import Fracture, Loading, Material, Solver, registry
from fracsim.solve import setup
from fracsim.solve.simulator import Simulator
from fracsim.verify.problems import damage_history

from .bars import bar, free, gripped, lattice, particles, scene

LAWS = registry.names("fracsim.damage")


def raw(name: str, F: Any, onset: float, crit: float) -> Any:
    law = registry.load("fracsim.damage", name, "fracture.law")
    Matrices = ti.types.ndarray(dtype=ti.types.matrix(3, 3, ti.f64), ndim=1)
    Scalars = ti.types.ndarray(dtype=ti.f64, ndim=1)

    @ti.kernel
    def evaluate(onset: ti.f64, crit: ti.f64, F: Matrices, out: Scalars):
        for p in range(F.shape[0]):
            out[p] = law.raw(F[p], F[p].determinant(), onset, crit)

    out = np.zeros(len(F))
    evaluate(onset, crit, np.ascontiguousarray(F, np.float64), out)
    return out


def test_stretch_law_is_linear_between_the_thresholds() -> None:
    stretches = np.array([0.5, 1.0, 1.5, 1.7, 2.1, 2.3, 5.0])
    F = np.array([np.diag([s, 0.9, 0.8]) for s in stretches])
    expected = np.clip((np.maximum(stretches, 0.9) - 1.5) / 0.8, 0, 1)
    assert raw("stretch", F, 1.5, 2.3) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_every_law_is_bounded_and_does_not_see_rotation(name: str) -> None:
    from .test_constitutive import random_F

    F = random_F(100)
    Q = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    d = raw(name, F, 1.5, 2.3)
    assert ((d >= 0) & (d <= 1)).all()
    assert raw(name, Q @ F, 1.5, 2.3) == pytest.approx(d, abs=1e-7)


@pytest.mark.parametrize("form", ["total", "updated"])
def test_damage_history_is_a_running_maximum(form: str) -> None:
    """The history of stretches 1, 1.5, 1.7, 2.1, 1.2, ... gives d = 0, 0, 0.25, 0.75, 0.75, ... on the particle."""
    solver = Solver(cells=20, precision="float64", formulation=form)
    s = scene(material=Material(E=1e2, nu=0.3), fracture=damage_history.THRESHOLDS, solver=solver)
    state = free(s, particles(lattice((0.6, 0.3, 0.3), solver.spacing), solver.spacing))
    exact = np.tile(damage_history.EXACT, (state.n, 1)).T
    assert damage_history.damage_after_each(state) == pytest.approx(exact, abs=1e-6)


def test_degraded_stress_and_its_energy() -> None:
    solver = Solver(cells=20, precision="float64")
    s = scene(material=Material(law="neo_hookean", E=1e3, nu=0.3), solver=solver)
    state = free(s, particles(lattice((0.6, 0.3, 0.3), solver.spacing), solver.spacing))
    state.points.F.from_numpy(np.tile(np.diag([1.8, 0.9, 0.9]), (state.n, 1, 1)))
    whole, energy, stretch, _ = state.observe()
    state.points.D.from_numpy(np.full(state.n, 0.25))
    damaged, left, *_ = state.observe()
    assert damaged == pytest.approx(0.75 * whole, rel=1e-12)
    assert left == pytest.approx(0.75 * energy, rel=1e-12)
    assert stretch == pytest.approx(1.8, rel=1e-9)


def test_grip_particles_are_exempt_unless_asked() -> None:
    solver = Solver(cells=50)
    body = particles(lattice((0.6, 0.2, 0.2), solver.spacing), solver.spacing)
    loading = Loading(offset=0.15, thickness=0.05)
    off = gripped(scene(solver=solver, loading=loading), body).exempt
    on = gripped(scene(solver=solver, loading=loading, fracture=Fracture(at_grips=True)), body).exempt
    s = np.abs(body.X[:, 0].astype(float) - 1)
    assert (off == ((s >= 0.125) & (s <= 0.175))).all()
    assert not on.any()


@pytest.mark.parametrize("cells", [100, 150])
@pytest.mark.parametrize("axis", [0.0, 30.0])
def test_nothing_between_the_grips_is_exempt_even_where_they_are_close(cells: int, axis: float) -> None:
    """At the paper's smallest offset, 0.10 m: what may fail is all of the gauge, 0.15 m, whatever the cells."""
    solver = Solver(cells=cells)
    body = bar(solver, (0.4, 0.1, 0.1))
    state = gripped(scene(solver=solver, loading=Loading(offset=0.1, thickness=0.05, axis_deg=axis)), body)
    s = state.boundary.along(state.X0.astype(float))
    assert not state.exempt[np.abs(s) < 0.0749].any()
    assert (state.excess >= 0).all()
    assert state.excess.max() < 0.3
    assert (state.excess[np.abs(s) < 0.075 - 2.6 * solver.h] < 0.01).all()


def test_thresholds_rise_by_the_excess_beside_a_grip_and_only_there() -> None:
    """A bar at stretch 2, put in by hand: d = (1 / (1 + e) - 0.5) / 1 for thresholds 1.5 and 2.5."""
    solver = Solver(cells=50, precision="float64", pressure="particle", damping="none", projection=0.0)
    s = scene(material=Material(E=1e2, nu=0.3), fracture=Fracture(onset=1.5, crit=2.5), solver=solver,
              loading=Loading(offset=0.15, thickness=0.05, speed=1e-9))  # fmt: skip
    state = gripped(s, bar(solver))
    state.points.F.from_numpy(np.tile(np.diag([2.0, 1.0, 1.0]), (state.n, 1, 1)))
    state.run(2, 1e-9, 0.0)
    # (2 - l_onset) / (l_crit - l_onset) with l + e (l - 1) for l is (1 - 0.5 (1 + e)) / (1 + e). Excesses are stored in
    # steps of 1 / 4096; in 2e-9 s nothing moves.
    expected = np.where(state.exempt, 0, 1 / (1 + state.excess) - 0.5)
    assert state.points.D.to_numpy() == pytest.approx(expected, abs=2e-4)
    assert state.excess.max() > 0.1


def test_only_bodies_that_a_grip_holds_have_an_excess() -> None:
    """A bar, and above it a shorter one that ends beside the faces and hangs on no grip."""
    solver = Solver(cells=50)
    h, loading = solver.h, Loading(offset=0.2, thickness=0.05)
    held = lattice((0.6, 0.1, 0.1), solver.spacing)
    loose = lattice((0.3, 0.1, 0.1), solver.spacing) + np.float32([0, 0.1 + 2 * h, 0])
    body = particles(np.concatenate([held, loose]), solver.spacing)
    x = body.X.astype(float) - 1
    excess = setup.grips(scene(solver=solver, loading=loading)).excess(x, solver.spacing)
    assert excess[: len(held)].max() > 0.1
    assert (excess[len(held) :] == 0).all()


@pytest.mark.parametrize(("offset", "at_grips", "told"), [(0.06, False, 0), (0.03, False, 1), (0.03, True, 0)])
def test_a_pull_that_cannot_tear_says_so(offset: float, at_grips: bool, told: int) -> None:
    """Particles lie at 0.01, 0.03, ... m from the middle: grips from 0.005 to 0.055 m leave nothing."""
    solver = Solver(cells=50)
    body = particles(lattice((0.6, 0.2, 0.2), solver.spacing), solver.spacing)
    loading = Loading(offset=offset, thickness=0.05)
    s = scene(solver=solver, loading=loading, fracture=Fracture(at_grips=at_grips))
    assert sum("nothing between the grips can tear" in w for w in Simulator(s, body).report.warnings) == told


@pytest.mark.parametrize(("clamped", "told"), [(0, 0), (1, 0), (3, 1)])
def test_crushed_particles_are_mentioned_where_they_are_many(clamped: int, told: int) -> None:
    """One in 100,000 substeps of a particle: here of 100 substeps of 2,000 particles."""
    solver = Solver(cells=50)
    body = particles(lattice((0.4, 0.2, 0.2), solver.spacing), solver.spacing)
    simulator = Simulator(scene(solver=solver, loading=Loading(offset=0.12)), body)
    next(simulator.frames())
    report = simulator.report
    report.substeps, report.clamped = 100, clamped
    assert len(body) == 2000
    assert sum("J < 0.05" in w for w in report.summary()["warnings"]) == told
