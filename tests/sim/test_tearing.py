"""When and where things tear, against closed forms; and that numerical tearing is told from damage."""

from pathlib import Path

import numpy as np
import pytest

from fracsim import Asset, Capture, Fracture, Loading, Material, Solver
from fracsim.asset.build import build
from fracsim.fuzz.bodies import Body
from fracsim.fuzz.bodies import build as build_body
from fracsim.mpm.energy import kinetic
from fracsim.mpm.layout import layout, separate_fragments
from fracsim.mpm.state import State
from fracsim.records import Particles
from fracsim.solve.bonds import Bonds
from fracsim.solve.failed import FollowIntact
from fracsim.solve.fragments import judge
from fracsim.solve.simulator import Simulator
from fracsim.verify import closed_form
from fracsim.verify.problems import notch as notch_problem
from fracsim.verify.problems import softening as softening_problem
from fracsim.verify.pull import over_gauge, until_parted
from fracsim.verify.pull import simulator as pulled

from .bars import bar, free, lattice, particles, scene

CELLS = 50
H = 2 / CELLS


def softening(law: str, E: float, nu: float, onset: float, crit: float, speed: float, form: str = "total") -> Simulator:
    """A bar of 4 x 4 cells between sliding grips whose faces lie on nodes, 16 cells apart."""
    gauge = 16 * H
    duration = (crit + 0.1 - 1) * gauge / (2 * speed)
    s = scene(
        material=Material(law=law, E=E, nu=nu),
        fracture=Fracture(onset=onset, crit=crit),
        loading=Loading(offset=9 * H, thickness=2 * H, speed=speed, grips="sliding"),
        solver=Solver(cells=CELLS, formulation=form, damping="none"),
        capture=Capture(frames=120, fps=119 / duration),
    )
    return Simulator(s, bar(s.solver, (20 * H, 4 * H, 4 * H)))


@pytest.mark.parametrize(("row", "speed"), list(zip(softening_problem.ROWS[:3], (0.05, 0.05, 0.2), strict=True)))
def test_uniform_bar_breaks_at_the_closed_form_stretch(
    row: tuple[str, float, float, float, float], speed: float
) -> None:
    law, E, nu, onset, crit, *_ = row
    stretch, peak, _ = closed_form.softening(law, nu, onset, crit)
    simulator = softening(law, E, nu, onset, crit, speed)
    for _ in simulator.frames():
        if simulator.report.parted:
            break
    h = simulator.report.history
    at = int(np.argmax(h.load))
    stretch = over_gauge(simulator, law, nu, stretch, peak)
    # Inertia (speed / wave speed = 0.02), and 120 frames over the pull; it parts a frame or two after the peak.
    assert h.nominal_stretch[at] == pytest.approx(stretch, rel=0.02)
    assert h.load[at] / (4 * H) ** 2 / E == pytest.approx(peak, rel=0.015)
    assert simulator.report.break_frame is not None
    assert h.nominal_stretch[simulator.report.break_frame] == pytest.approx(stretch, rel=0.025)


def test_updated_reports_its_numerical_tearing() -> None:
    """With two particles a cell the grid lets go near 1.8, far below onset 2.6; the report says so."""
    simulator = softening("neo_hookean", 2e4, 0.45, 2.6, 3.0, 0.4, "updated")
    for _ in simulator.frames():
        if simulator.report.parted:
            break
    report = simulator.report.summary()
    assert report["break_frame"] is None
    assert report["torn_frame"] is not None
    assert simulator.report.history.nominal_stretch[report["torn_frame"]] < 2.3
    assert any("numerically torn" in w for w in report["warnings"])


def test_notched_bar_breaks_at_its_notch() -> None:
    """A notch one cell deep, off centre: the first failed particle lies within a cell of it."""
    bar, solver = notch_problem.BAR, Solver(cells=CELLS)
    simulator = pulled(solver, bar, notch_problem.MATERIAL, notch_problem.FRACTURE, 0.03, 1.9, 200)
    first = until_parted(simulator)
    assert first is not None, "nothing failed"
    assert np.abs(first[:, 0] - 1 - bar.at).max() <= H + solver.spacing


def test_fragments_do_not_tie_each_other() -> None:
    """Halves of a bar with a failed layer of one particle between them fly apart without any strain."""
    s = scene(
        material=Material(law="neo_hookean", E=2e4, nu=0.3),
        fracture=Fracture(onset=8, crit=9),
        loading=Loading(offset=0.15, thickness=0.05),
        solver=Solver(cells=CELLS, precision="float64"),
        capture=Capture(frames=1),
    )
    body = bar(s.solver)
    body = particles(body.X[np.lexsort(body.X.T)], body.spacing)
    state = free(s, body)
    side = np.sign(state.X0[:, 0] - H / 4)
    failed = np.abs(state.X0[:, 0] - H / 4) < H / 8
    state.points.D.from_numpy(failed.astype(float))
    state.points.V.from_numpy(np.stack([side, 0 * side, 0 * side], axis=1))
    label = Bonds(body.X, body.spacing, H).fragments(failed)
    assert set(label[~failed]) == {0, 1}
    state.split(label)
    state.run(50, 5e-4, 0.0)
    intact = ~failed
    assert np.abs(state.points.F.to_numpy()[intact] - np.eye(3)).max() < 1e-10
    assert np.abs(state.points.U.to_numpy()[intact, 0] - 0.025 * side[intact]).max() < 1e-10


DUCK = Path(__file__).parents[3] / "shared" / "data" / "Duck.glb"


@pytest.mark.skipif(not DUCK.exists(), reason="the duck lies beside the repository, not in it")
@pytest.mark.parametrize("form", ["total", "updated"])
def test_thresholds_beyond_the_pull_leave_the_duck_whole(form: str) -> None:
    """Thresholds 6 / 7, pulled to nominal stretch 2.9: `total` stretches it on, `updated` parts it and says so."""
    s = scene(
        asset=Asset(kind="mesh", path=str(DUCK)),
        material=Material(law="neo_hookean", E=2e4, nu=0.45, viscosity=0.444),
        fracture=Fracture(onset=6, crit=7),
        loading=Loading(axis_deg=30, speed=0.8, offset=0.15),
        solver=Solver(cells=75, formulation=form),
        capture=Capture(frames=31),
    )
    simulator = Simulator(s, build(s.asset, s.solver.spacing, 0))
    for _ in simulator.frames():
        pass
    report = simulator.report.summary()
    if form == "total":
        assert not simulator.report.parted
        assert report["failed"] < 5e-3  # at the grips stretches reach 7 by then; the crack must not run
    else:
        assert report["torn_frame"] is not None
        assert report["break_frame"] is None
        assert any("numerically torn" in w for w in report["warnings"])


def test_failed_particles_follow_one_side() -> None:
    """Two halves moved apart rigidly: a failed particle moves exactly as the half that it is nearest to."""
    X = lattice((0.4, 0.1, 0.1), 0.02)
    side = np.where(X[:, 0] < 1, -1.0, 1.0)
    x = X + np.stack([0.3 * side, 0.1 * side, 0 * side], axis=1).astype(np.float32)
    F = np.tile(np.eye(3, dtype=np.float32), (len(X), 1, 1))
    v = np.stack([side, 0 * side, 0 * side], axis=1).astype(np.float32)
    failed = np.abs(X[:, 0] - 1) < 0.035
    expected = x.copy()
    x[failed] = 0
    FollowIntact(X, 0.04)(x, v, F, failed, np.zeros(len(X), int))
    assert np.abs(x - expected).max() < 1e-5
    assert np.allclose(v[failed, 0], side[failed])


def test_bonds_tell_damage_from_the_grid() -> None:
    """Halves that drift apart: broken when a layer between them failed, torn when F knows nothing of the gap."""
    X = lattice((0.4, 0.08, 0.08), 0.02)
    side = (X[:, 0] > 1.15).astype(int) - (X[:, 0] < 0.85)
    bonds = Bonds(X, 0.02, 0.04)
    F = np.tile(np.eye(3, dtype=np.float32), (len(X), 1, 1))
    none = np.zeros(len(X), bool)
    apart = X + np.float32([0.1, 0, 0]) * np.sign(X[:, :1] - 1)
    assert judge(bonds, side, X, F, none) == "whole"
    assert judge(bonds, side, apart, F, none) == "torn"
    assert judge(bonds, side, apart, F, np.abs(X[:, 0] - 1) < 0.025) == "broken"
    stretched = X.copy()
    stretched[:, 0] = 1 + 4 * (X[:, 0] - 1)
    assert judge(bonds, side, stretched, F * np.float32([4, 1, 1]), none) == "whole"


def test_particles_record_checks_its_shapes() -> None:
    body = bar(Solver(cells=20))
    with pytest.raises(AssertionError, match=r"Particles\.volume has shape"):
        Particles(**{**vars(body), "volume": body.volume[1:]})


def test_fragments_take_over_the_velocities_of_their_nodes() -> None:
    """A node that two fragments shared moves on with both: momentum and kinetic energy are kept to round-off."""
    solver = Solver(cells=CELLS, precision="float64", projection=0.0)
    s = scene(
        material=Material(law="neo_hookean", E=1e2, nu=0.0, density=2e4),
        fracture=Fracture(onset=8, crit=9),
        loading=Loading(offset=0.15, thickness=0.05),
        solver=solver,
        capture=Capture(frames=1),
    )
    state = free(s, bar(s.solver))
    state.points.V.from_numpy(np.random.default_rng(0).normal(size=(state.n, 3)) + [0.3, 0.2, 0.1])
    state.run(20, 1e-5, 0.0)

    def total(state: State) -> np.ndarray:
        v = state.grid.velocity.to_numpy()
        return np.append(v[:, 3] @ v[:, :3], kinetic(state))

    before = total(state)
    state.split((state.X0[:, 0] > H / 3).astype(int))
    state.run(1, 1e-9, 0.0)
    assert np.allclose(total(state), before, rtol=1e-6)
    # ... and once more, when the fragments lie aside already and one of them has lost some particles.
    label = (state.X0[:, 0] > H / 3).astype(int) + (state.X0[:, 0] > 0.2)
    label[np.abs(state.X0[:, 0] - 0.2) < 1e-3] = -1
    state.split(label)
    state.run(1, 1e-9, 0.0)
    assert np.allclose(total(state), before, rtol=1e-6)


def test_fragments_lie_aside_in_their_own_planes_although_positions_are_rounded() -> None:
    """Particles on faces of cells, in float32: each keeps its cell, and each plane of nodes has one fragment."""
    h, rng = 0.02, np.random.default_rng(0)
    face = h * (rng.integers(-40, 40, 2000) + 0.5)
    x = np.stack([face + rng.choice([-1e-8, 0, 1e-8], 2000), *rng.normal(size=(2, 2000))], axis=1).astype(np.float32)
    label = rng.integers(0, 5, 2000)
    out, moved, fragment = separate_fragments(x, label, h)
    cell, now = (np.floor(y[:, 0] / h - 0.5).astype(int) for y in (x, out))
    assert (now == cell + moved[label]).all()
    laid = layout(out / h, 1, 0)
    assert laid.shape[0] == len(fragment)
    for plane in range(3):
        assert (fragment[now + plane - laid.lowest[0]] == label).all()


def test_fragments_that_are_held_outlast_larger_crumbs() -> None:
    """A wire in three pieces: the middle one, 4 particles, is a crumb, the end, 2 in a grip, is not."""
    s = scene(solver=Solver(cells=CELLS), loading=Loading(offset=0.34, thickness=0.05), capture=Capture(frames=1))
    simulator = Simulator(s, build_body(Body(counts=[36, 1, 1]), s.solver))
    along = simulator.particles.X[:, 0].argsort()
    d = np.zeros(36, simulator.state.dtype)
    d[along[[-3, -8]]] = 1
    simulator.state.points.D.from_numpy(d)
    simulator.fragments.update()
    assert simulator.fragments.of[along].tolist() == [0] * 28 + [-1] * 6 + [1] * 2
    assert (simulator.state.points.D.to_numpy()[along[-8:-2]] == 1).all()


def test_a_bar_that_the_grid_parts_recoils_onto_nodes_in_use() -> None:
    """In `updated` a stiff bar snaps numerically within a few substeps, and particles fly at half the wave speed."""
    solver = Solver(cells=44, formulation="updated")
    s = scene(
        material=Material(law="neo_hookean", E=3e5, nu=0.3, density=150),
        fracture=Fracture(onset=8, crit=9),
        loading=Loading(offset=0.127, thickness=0.05, speed=0.5),
        solver=solver,
        capture=Capture(frames=8, fps=16),
    )
    body = build_body(Body(counts=[16, 4, 5], shift=[0.4, -0.5, 0.1]), solver)
    simulator = Simulator(s, body)
    for _ in simulator.frames():  # used to end here: "left the grid (field x)"
        pass
    assert simulator.report.torn_frame is not None


def test_an_object_of_which_nothing_is_left_is_broken() -> None:
    s = scene(
        material=Material(law="neo_hookean", E=2e4, nu=0.3),
        fracture=Fracture(onset=8, crit=9),
        loading=Loading(offset=0.15, thickness=0.05),
        solver=Solver(cells=30),
        capture=Capture(frames=3),
    )
    simulator = Simulator(s, bar(s.solver))
    frames = simulator.frames()
    next(frames)
    simulator.state.points.D.from_numpy(np.ones(simulator.state.n, np.float32))
    assert [frame.failed.all() for frame in frames] == [True, True]
    assert simulator.report.break_frame == 1
