"""The stability bound, against the blow-up of an isolated particle and of a block."""

import contextlib

import numpy as np
import pytest

from fracsim import Capture, Fracture, Loading, Material, Scene, Solver
from fracsim.bench.spectrum import ratio
from fracsim.lab.stage import lattice, ordered
from fracsim.mpm import params as slot
from fracsim.mpm.state import State
from fracsim.mpm.timestep import BODY, damping, limit, require_stable, rest_stiffness, stable, stable_at_rest
from fracsim.scene.vocab import CENTRE, DT0
from fracsim.solve.march import SimulationError
from fracsim.solve.setup import medium, ready
from fracsim.solve.simulator import Simulator

from .bars import bar, free, particles, scene


def setting(dt: float | str = "auto", viscosity: float = 0.0, form: str = "total", **solver: object) -> Scene:
    return scene(
        material=Material(law="neo_hookean", E=1e4, nu=0.4, viscosity=viscosity),
        fracture=Fracture(onset=8, crit=9),
        solver=Solver(**{"cells": 50, "precision": "float64", "dt": dt, "formulation": form, **solver}),
        loading=Loading(offset=0.02, thickness=0.02),
        capture=Capture(frames=3),
    )


def single(scene: Scene, X: np.ndarray) -> State:
    """One free particle."""
    return free(scene, particles(X, 0.02))


def blows_up(state: State, dt: float) -> bool:
    state.points.F.from_numpy(np.tile((1 + 1e-6) * np.eye(3), (state.n, 1, 1)))
    state.run(400, dt, 0.0)
    return not np.abs(state.points.F.to_numpy()[0] - np.eye(3)).max() < 1e-4


@pytest.mark.parametrize("viscosity", [0.0, 10.0])
def test_bound_is_where_an_isolated_particle_blows_up(viscosity: float) -> None:
    bound = stable_at_rest(medium(setting(viscosity=viscosity)))
    X = np.float32([[1.003, 1.005, 0.998]])
    assert not blows_up(single(setting(viscosity=viscosity), X), 0.97 * bound)
    assert blows_up(single(setting(viscosity=viscosity), X), 1.03 * bound)


@pytest.mark.parametrize("viscosity", [0.0, 10.0, 300.0])
def test_auto_is_stable_for_a_particle_by_itself(viscosity: float) -> None:
    """`limit` counts on a body, but dt^2 k + 2 b dt <= 4 still holds for one particle at solver.safety=0.8."""
    m = medium(setting(viscosity=viscosity))
    dt = limit(m, rest_stiffness(m), 0.0, 0.0)
    assert stable_at_rest(m) * 0.8 < dt <= stable_at_rest(m)
    assert not blows_up(single(setting(viscosity=viscosity), np.float32([[1.003, 1.005, 0.998]])), 0.995 * dt)


@pytest.mark.parametrize("viscosity", [0.0, 100.0])
def test_a_body_bears_the_substep_of_its_spectrum(viscosity: float) -> None:
    """A block of 4^3 cells, whose largest eigenvalue is 0.6 of that of a particle, is stable where `stable` says so."""
    s = setting(viscosity=viscosity)
    m = medium(s)
    X = ordered(lattice((4 * m.h,) * 3, m.solver.spacing), m.h)
    body = ratio((X - CENTRE) / m.h, np.ones(len(X)))
    assert body == pytest.approx(0.606, abs=0.002)
    assert body < BODY
    bound = stable(m, rest_stiffness(m), body)
    assert bound > 1.2 * stable_at_rest(m)
    assert not blows_up(single(s, X.astype(np.float32)), 0.99 * bound)


def test_what_shares_no_nodes_has_the_spectrum_of_a_particle() -> None:
    """One particle, two that are far from each other, and a sheet of one layer."""
    sheet = np.stack([*np.meshgrid(np.arange(8) / 2 + 0.25, np.arange(8) / 2 + 0.25), np.full((8, 8), 0.25)], axis=-1)
    for y in (np.array([[0.3, 0.2, 0.1]]), np.array([[0.3, 0.2, 0.1], [9.0, 9.0, 9.0]]), sheet.reshape(-1, 3)):
        assert ratio(y, np.ones(len(y))) == pytest.approx(1, abs=1e-6)


def test_auto_dt_lands_on_frames_and_respects_the_bound() -> None:
    s = setting()
    s.loading = Loading(offset=0.15, thickness=0.05, speed=1.0)
    simulator = Simulator(s, bar(s.solver))
    times = [frame.t for frame in simulator.frames()]
    h = simulator.report.history
    assert times == pytest.approx([0, 0.01, 0.02])
    assert h.dt_t[-1] == pytest.approx(0.02, rel=1e-9)
    m = medium(s)
    assert max(h.dt) <= 0.8 * stable(m, rest_stiffness(m), BODY) * (1 + 1e-9)


def test_fixed_dt_beyond_the_bound_is_refused_with_the_bound() -> None:
    s = setting(dt=0.01)
    with pytest.raises(ValueError, match=r"solver\.dt=0\.01 s exceeds the stability bound .*E=10000, nu=0\.4"):
        require_stable(medium(s))
    assert "exceeds" in require_stable(medium(setting(dt=0.01, dt_override=True)))
    assert require_stable(medium(setting(dt=1e-4))) == ""


def test_blow_up_stops_the_run_and_names_the_particle() -> None:
    s = setting(dt=6e-3, dt_override=True)
    s.loading = Loading(offset=0.15, thickness=0.05, speed=1.0)
    s.capture = Capture(frames=60)
    with pytest.raises(SimulationError, match=r"frame \d+.*(field v|field F)"):
        list(Simulator(s, bar(s.solver)).frames())


def test_a_particle_that_is_too_fast_keeps_the_speed_that_the_message_tells() -> None:
    """Not the one at the last look, up to 16 substeps before, which here is none."""
    s = setting(max_speed=1.0)
    s.loading = Loading(offset=0.15, thickness=0.05, speed=0.5)
    body = bar(s.solver)
    state = free(s, body)
    state.points.F.from_numpy(np.tile(np.diag([2.0, 1.0, 1.0]), (state.n, 1, 1)))
    state.run(16, 1e-3, 0.0)
    kind, p, _ = state.fault()
    assert kind == slot.SPEED_FAULT
    assert np.linalg.norm(state.points.V.to_numpy()[p]) > 1.0


def test_physical_damping_does_not_depend_on_dt_and_the_papers_factors_do() -> None:
    s = setting(viscosity=44.444444)
    s.material.decay = 5.0012504
    assert damping(medium(s), 1e-4).viscosity == damping(medium(s), 2e-4).viscosity == s.material.viscosity
    assert damping(medium(s), 2e-4).keep == pytest.approx(damping(medium(s), 1e-4).keep ** 2)
    s.solver.damping = "per_substep"
    # r = 4 dt (2 eta) / (density h^2) is 0.5 again, whatever dt and h are.
    for dt in (DT0, 3 * DT0):
        r = 4 * dt * damping(medium(s), dt).viscosity / (200 * s.solver.h**2)
        assert r == pytest.approx(0.5, rel=1e-6)
        assert damping(medium(s), dt).keep == pytest.approx(0.9995, rel=1e-8)
    s.solver.damping = "none"
    assert damping(medium(s), DT0).viscosity == 0
    assert damping(medium(s), DT0).keep == 1


def test_a_fixed_dt_that_stretch_makes_too_long_is_told() -> None:
    """Stable at rest, but the bound of a neo-Hookean solid falls as it gets thinner."""
    s = setting()
    s.solver.dt = 0.97 * stable_at_rest(medium(s))
    s.loading = Loading(offset=0.15, thickness=0.05, speed=2.0)
    s.capture = Capture(frames=12)
    simulator = Simulator(s, bar(s.solver))
    with contextlib.suppress(SimulationError):
        list(simulator.frames())
    assert sum("exceeds the stability bound at the present stretch" in w for w in simulator.report.warnings) == 1


def test_the_bound_sees_damage() -> None:
    """(1 - d) of the stiffness: with d = 3/4 the substep may be twice as long."""
    s = setting()
    state = free(s, bar(s.solver))
    whole = state.survey().stiffness
    state.points.D.from_numpy(np.full(state.n, 0.75))
    assert state.survey().stiffness == pytest.approx(whole / 4)


def test_double_precision_is_refused_where_there_is_none() -> None:
    s = setting()
    s.backend.arch = "vulkan"
    with pytest.raises(ValueError, match=r"solver\.precision=float64 is not possible with backend\.arch=vulkan"):
        ready(s)


def test_a_damping_that_no_substep_bears_is_refused() -> None:
    """r = 4 viscosity dt0 / (density h0^2) = 2 at 177.8 Pa s; 2 - r is what keeps the bound above zero."""
    s = setting(viscosity=180.0, damping="per_substep")
    with pytest.raises(
        ValueError, match=r"material\.viscosity=180 Pa s is an RPIC damping of r = 2\.0.*below 178 Pa s"
    ):
        ready(s)
    assert ready(setting(viscosity=170.0, damping="per_substep")).warnings == []
