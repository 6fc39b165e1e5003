"""The stress test draws what it says, sees what is wrong, and goes on where it stopped."""

import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from fracsim import Backend, Fracture, Loading, Material, Scene, Solver
from fracsim.fuzz import blowup, bodies, fitting
from fracsim.fuzz.__main__ import main
from fracsim.fuzz.case import Case, Start, read, sensible, write
from fracsim.fuzz.draw import CYCLE, FAMILIES, draw
from fracsim.fuzz.invariants import Watch
from fracsim.fuzz.run import Outcome, run
from fracsim.fuzz.study import JOURNAL, Worker, journal, numbers, study
from fracsim.fuzz.table import lines, table
from fracsim.lab import stage
from fracsim.mpm import params as slot
from fracsim.mpm.timestep import stable_at_rest
from fracsim.records import Frame
from fracsim.solve import setup
from fracsim.solve.march import SimulationError
from fracsim.solve.simulator import Simulator

pytestmark = pytest.mark.usefixtures("taichi")


def test_a_case_depends_on_seed_and_number_alone() -> None:
    for number in range(0, len(CYCLE), 3):
        assert draw(3, number) == draw(3, number)
        assert draw(3, number) != draw(4, number)


@contextmanager
def suppress_kinds(*kinds: str) -> Iterator[None]:
    """Errors of these kinds may be raised."""
    try:
        yield
    except ValueError as error:
        if fitting.kind(error) not in kinds:
            raise


def test_every_family_is_drawn_and_scenes_stay_within_the_ranges_of_single_fields() -> None:
    """A refusal must come from a combination of fields, which is what the study is about."""
    seen = set()
    for number in range(2 * len(CYCLE)):
        case = draw(0, number)
        seen.add(case.family)
        with suppress_kinds("gauge", "thresholds"):
            case.resolve()
    assert seen == set(FAMILIES)
    assert numbers(50, ("long",)) == [k for k in range(50) if CYCLE[k % len(CYCLE)] == "long"] != []


@pytest.mark.parametrize("kind", bodies.KINDS)
def test_bodies_have_one_place_and_one_volume_a_particle(kind: str) -> None:
    body = bodies.build(bodies.Body(kind=kind, counts=[8, 4, 4]), Solver(cells=50))
    assert len(np.unique(body.X, axis=0)) == len(body) > 20
    # Positions about (1, 1, 1) to an ulp of float32; the halves with an odd particle between them lie evenly too.
    assert kind == "cloud" or np.abs(body.X.mean(axis=0) - 1).max() < 1e-6


@pytest.mark.parametrize(("F", "sign"), [("inverted", -1), ("flat", 0), ("stretched", 1)])
def test_a_start_has_the_volume_ratio_that_it_says(F: str, sign: int) -> None:
    gradients = Start(F=F, amount=1.5)._gradients(20, np.random.default_rng(0))
    assert np.linalg.det(gradients) == pytest.approx(np.full(20, 1.5 * sign), abs=1e-12)


@pytest.fixture
def watched() -> tuple[Simulator, Watch, Frame]:
    """A pulled bar after its first frame of motion."""
    scene = Scene(material=Material(law="neo_hookean", E=1e4), fracture=Fracture(onset=8, crit=9),
                  loading=Loading(offset=0.2, thickness=0.1), solver=Solver(cells=30, damping="none"),
                  backend=Backend(threads=1))  # fmt: skip
    simulator = Simulator(scene, stage.bar(scene.solver))
    watch = Watch(simulator)
    frames = simulator.frames()
    watch.frame(next(frames))
    watch.frame(next(frames))
    assert watch.violations == []
    return simulator, watch, next(frames)


def planted(watch: Watch, frame: Frame) -> list[str]:
    """Kinds of violations that a frame brings."""
    watch.frame(frame)
    return [sentence.partition(":")[0] for sentence in watch.violations]


def test_what_is_sound_passes(watched: tuple[Simulator, Watch, Frame]) -> None:
    assert planted(watched[1], watched[2]) == []


def test_a_number_that_is_not_finite_is_seen(watched: tuple[Simulator, Watch, Frame]) -> None:
    watched[2].v[3, 1] = np.nan
    assert "finite" in planted(watched[1], watched[2])


def test_damage_that_falls_or_leaves_its_range_is_seen(watched: tuple[Simulator, Watch, Frame]) -> None:
    watch, frame = watched[1:]
    watch._last_d = np.full_like(frame.d, 0.5)
    assert planted(watch, replace(frame, d=np.full_like(frame.d, 0.25))) == ["damage"]
    watch._kinds.clear()
    assert planted(watch, replace(frame, d=np.full_like(frame.d, 1.5)))[-1] == "damage"


def test_energy_from_nowhere_is_seen(watched: tuple[Simulator, Watch, Frame]) -> None:
    """Half of the work more elastic energy than there is; a tenth less is a loss."""
    simulator, watch, frame = watched
    work = simulator.state.sums()[slot.GRIP_WORK]
    simulator.report.history.elastic[-1] -= 0.1 * work
    assert planted(watch, frame) == []
    simulator.report.history.elastic[-1] += 0.6 * work
    assert planted(watch, frame) == ["energy"]


def test_momentum_from_nowhere_is_seen(watched: tuple[Simulator, Watch, Frame]) -> None:
    simulator, watch, frame = watched
    V = simulator.state.points.V.to_numpy()
    simulator.state.points.V.from_numpy(V + np.float32([0.1, 0, 0]))
    assert planted(watch, frame) == ["momentum"]


def test_a_grip_that_lags_is_seen(watched: tuple[Simulator, Watch, Frame]) -> None:
    """Both where the state has it; the frame shows it at v t all the same."""
    simulator, watch, frame = watched
    U = simulator.state.points.U.to_numpy()
    simulator.state.points.U.from_numpy(np.where(simulator.state.side[:, None] != 0, 0.99 * U, U))
    assert planted(watch, frame) == ["grips"]


def test_a_frame_at_the_wrong_time_and_place_is_seen(watched: tuple[Simulator, Watch, Frame]) -> None:
    assert {"frame", "time"} <= set(planted(watched[1], replace(watched[2], t=0.03, x=watched[2].x + np.float32(0.01))))


def test_mass_that_vanishes_from_the_grid_is_seen(watched: tuple[Simulator, Watch, Frame]) -> None:
    simulator, watch, frame = watched
    grid = simulator.state.grid.velocity.to_numpy()
    grid[:, 3] *= 0.9
    simulator.state.grid.velocity.from_numpy(grid)
    watch.round(1, 1e-4, frame.t)
    assert [sentence.partition(":")[0] for sentence in watch.violations] == ["mass"]


def test_which_error_fits() -> None:
    """Words of the solver: a blow-up fits no sensible scene; an error without a field or a way out fits none."""
    blow = SimulationError("frame 3, substep 9, particle 1 at [1 1 1] m: field v is not finite. Use solver.dt=auto.")
    assert fitting.unfit(blow, sensible=False) == []
    assert "sensible" in fitting.unfit(blow, sensible=True)[0]
    wordless = ValueError("loading.offset=1: the lower grip holds no particle.")
    assert fitting.unfit(wordless, sensible=True) == [f"the error names no way out: {wordless}"]
    empty = ValueError("loading.offset=1: the lower grip holds no particle. Choose a smaller loading.offset.")
    assert fitting.unfit(empty, sensible=True) == []
    assert len(fitting.unfit(ValueError("the lower grip holds no particle"), sensible=True)) == 2
    assert "no fitting error" in fitting.unfit(ValueError("material.E=0 is not allowed"), sensible=False)[0]


def plain(number: int = 0, **solver: object) -> Case:
    """A small, sensible bar."""
    scene = {
        "material": {"law": "neo_hookean", "E": 1e4},
        "loading": {"offset": 0.15, "thickness": 0.1, "speed": 0.5},
        "solver": {"cells": 40, **solver},
        "capture": {"frames": 3},
        "backend": {"threads": 1},
    }
    return Case(family="material", seed=0, number=number, scene=scene, body=bodies.Body(counts=[16, 4, 4]))


def test_what_is_sensible() -> None:
    case = plain()
    assert sensible(case, case.resolve())
    assert not sensible(plain(dt=1e-4), plain(dt=1e-4).resolve())
    assert not sensible(replace(case, start=Start(F="flat")), case.resolve())
    case.scene["loading"]["speed"] = 5.0  # waves run at 7 m/s
    assert not sensible(case, case.resolve())


def test_a_scene_without_a_stable_substep_is_drawn_and_not_sensible() -> None:
    """Viscosity per substep with r >= 2."""
    case = draw(3, 132)
    scene = case.resolve()
    assert scene.solver.damping == "per_substep"
    assert stable_at_rest(setup.medium(scene)) == 0
    assert not sensible(case, scene)


def test_a_replay_file_round_trips(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for case in (draw(0, 5), draw(0, 6), draw(0, 7)):
        write(case, tmp_path / "case.yaml", "a comment\nin two lines")
        assert read(tmp_path / "case.yaml") == case
    case = plain(dt=0.01, dt_override=True)
    case.scene["material"]["E"] = 1e5
    case.scene["capture"]["frames"] = 60
    write(case, tmp_path / "case.yaml")
    assert main(["--replay", str(tmp_path / "case.yaml")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "ended by blow-up" in printed
    assert "refused as it should" in printed
    (tmp_path / "other.yaml").write_text("a: 1\n")
    assert main(["--replay", str(tmp_path / "other.yaml")]) == 2
    assert "is no scene of this study" in capsys.readouterr().err


def test_cases_end_as_they_should() -> None:
    """Finished; refused before a substep; a start that nothing bears; a combination that is none."""
    assert run(plain()).verdict == "finished"
    far = plain()
    far.scene["loading"]["offset"] = 0.9
    assert (run(far).verdict, run(far).reason) == ("refused", "empty grip")
    start = replace(plain(), start=Start(F="inverted", amount=1.0))
    assert run(start).verdict == "refused"
    bad = plain(formulation="neither")
    assert (run(bad).verdict, run(bad).wrong[0][:16]) == ("wrong", "no fitting error")


@pytest.mark.parametrize("number", [203, 346])
def test_what_recoils_into_its_grip_may_be_crushed_for_a_while_and_recovers(number: int) -> None:
    """A neo-Hookean bar that a shock without friction crushed, and fixed corotated material torn at a stretch of 2.7:
    its stress is linear in the stretch, so a shock that stops it inverts it. All invariants hold, energy included."""
    seen: list[Simulator] = []
    out = run(draw(0, number), lambda simulator, frame, watch: seen.append(simulator))
    assert (out.verdict, out.wrong, out.parted) == ("finished", [], True)
    state = seen[-1].state
    assert np.linalg.det(state.points.F.to_numpy()[state.points.D.to_numpy() < 1]).min() > 0.5


def test_a_run_that_would_hardly_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here after half the substeps that all of it takes at rest; sensible scenes of the study take up to 4 times."""
    monkeypatch.setattr("fracsim.solve.simulator.PATIENCE", 0.5)
    case = plain()
    case.scene["loading"]["speed"] = 2.0
    case.scene["fracture"] = {"onset": 9.0, "crit": 10.0}
    case.scene["capture"]["frames"] = 40
    out = run(case)
    assert (out.reason, out.wrong[0][:24]) == ("slow", "slow in a sensible scene")
    error = SimulationError(out.error)
    assert fitting.unfit(error, sensible=False) == []
    assert "Use a slower loading.speed" in out.error


def misbehave(case: Case) -> Outcome:
    """In the place of `run`: number 1 crashes, number 2 hangs."""
    if case.number == 1:
        os._exit(7)
    if case.number == 2:
        time.sleep(60)
    return Outcome(family=case.family, seed=case.seed, number=case.number, verdict="finished")


def test_a_crash_and_a_hang_are_wrong_and_not_the_end(tmp_path: Path) -> None:
    outcomes = list(study(tmp_path, 0, [0, 1, 2, 3], Worker(misbehave, limit=8.0)))
    assert [o.verdict for o in outcomes] == ["finished", "wrong", "wrong", "finished"]
    assert outcomes[1].wrong == ["crashed: the process ended with status 7"]
    assert outcomes[2].wrong == ["hung: no end within 8 s"]
    kept = sorted(p.name for p in (tmp_path / "wrong").iterdir())
    assert kept == [f"{draw(0, 2).name}.yaml", f"{draw(0, 1).name}.yaml"]
    assert "2" in "".join(lines(outcomes))
    assert table(outcomes).row_count == 5  # material, thresholds, grips, damping and all of them


def test_resuming_skips_what_is_in_the_journal(tmp_path: Path) -> None:
    """A line that was cut short is run again; another seed is another study."""
    done = [Outcome(family="material", seed=0, number=k, verdict="finished") for k in (0, 3)]
    (tmp_path / JOURNAL).write_text("".join(json.dumps(asdict(o)) + "\n" for o in done) + '{"family": "mat')
    assert set(journal(tmp_path, 0)) == {0, 3}
    assert [o.number for o in study(tmp_path, 0, [0, 3, 4], Worker(misbehave))] == [4]
    assert set(journal(tmp_path, 0)) == {0, 3, 4}
    assert [o.number for o in study(tmp_path, 1, [0], Worker(misbehave))] == [0]


def test_the_blow_up_of_an_isolated_particle_is_at_the_bound() -> None:
    margin = blowup.measure(blowup.Setting("neo_hookean", 0.3, "total", 0.0, "particle"))
    assert margin.ratio == pytest.approx(1.0, abs=0.01)
    assert margin.kept
    assert not replace(margin, blowup=0.9 * margin.bound).kept
    assert not replace(margin, blowup=1.2 * margin.bound).kept
    assert blowup.table([margin]).row_count == 1
