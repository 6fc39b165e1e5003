"""A run is silent, and its outcome says what happened."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from fracsim import Material, Output, Scene, compose
from fracsim.run import console, lines, pipeline, recorder
from fracsim.run.attempt import Attempt, Task
from fracsim.run.outcome import Outcome, health
from fracsim.run.watcher import Watcher
from fracsim.version import __version__
from tests.command import SMALL

TORN = (*SMALL, "capture.frames=8", "loading.speed=4", "asset=bar", "material=rubber")
"""Breaks within eight frames, with a sound energy balance."""


def report(**changes: Any) -> dict[str, Any]:
    """The report of a sound run of 1,000 particles and 100 substeps, with 10 J of work."""
    energy = {"grip_work": 12.0, "gravity_work": -2.0, "unaccounted": 0.1, **changes.pop("energy", {})}
    return {"break_frame": 5, "torn_frame": None, "particles": 1000, "substeps": 100, "clamped": 0, "energy": energy,
            **changes}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "status", "reason"),
    [
        ({}, "complete", ""),
        ({"break_frame": None}, "never breaks", ""),
        ({"torn_frame": 3, "break_frame": None}, "suspect", "numerically torn at frame 3"),
        # 5 % of 12 J by the grips and 2 J against gravity.
        ({"energy": {"unaccounted": 0.69}}, "complete", ""),
        ({"energy": {"unaccounted": -0.71}}, "suspect", "energy unaccounted: -0.71 J of 14 J of work"),
        ({"energy": {"unaccounted": math.nan}}, "suspect", "energy unaccounted: nan J of 14 J of work"),
        ({"energy": {"unaccounted": None}}, "suspect", "energy unaccounted: nan J of 14 J of work"),  # of meta.json
        # 1e-3 of all substeps of all particles.
        ({"clamped": 100}, "complete", ""),
        ({"clamped": 200}, "suspect", "J < 0.05 in 0.2 % of all substeps of all particles"),
        ({"clamped": 200, "torn_frame": 1}, "suspect", "numerically torn at frame 1; J < 0.05 in 0.2 % of all "
                                                     "substeps of all particles"),
        ({"substeps": 0, "break_frame": None}, "never breaks", ""),
    ],
)  # fmt: skip
def test_when_numbers_can_be_trusted(changes: dict[str, Any], status: str, reason: str) -> None:
    assert health(report(**changes)) == (status, reason)


class Recorder(Watcher):
    """Keeps what a run reports."""

    def __init__(self) -> None:
        self.frames: list[int] = []
        self.times: list[float] = []

    def substeps(self, done: int, dt: float, t: float) -> None:
        self.times.append(t)

    def frame(self, index: int) -> None:
        self.frames.append(index)


def test_a_run_is_silent_and_is_watched(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    scene, watch = compose(*TORN, f"output.folder={tmp_path}"), Recorder()
    outcome = pipeline.run(scene, watch)
    assert capfd.readouterr() == ("", "")
    assert (outcome.status, outcome.reason, outcome.frames) == ("complete", "", 8)
    assert outcome.report["break_frame"] is not None
    assert set(outcome.seconds) == {"prepare", "simulate", "render", "write"}
    assert outcome.sample().path == outcome.path
    assert watch.frames == list(range(8))
    assert watch.times == sorted(watch.times)
    assert watch.times[-1] == pytest.approx(0.07)

    again = pipeline.run(scene, watch)
    assert (again.status, again.path, again.frames) == ("existing", outcome.path, 8)
    assert dict(again.report) == outcome.sample().meta["report"]
    assert watch.frames == list(range(8))
    assert (again.reason, capfd.readouterr()) == ("", ("", ""))

    assert outcome.path is not None
    edit_sources(outcome.path, "maps/stress.py")
    other = pipeline.run(scene, watch)
    assert (other.status, other.reason) == ("existing", f"made by fracsim {__version__} with another stress.py: "
                                                        "output.overwrite=true makes it again")  # fmt: skip
    console.show(scene, other, 1.0)
    assert capfd.readouterr().out == f"{outcome.path} is already there and whole, {other.reason}\n"
    line = lines._ending(Attempt(Task(scene), outcome.path.name, other, 0.0))
    assert line == f"already there, {other.reason}"


def edit_sources(sample: Path, name: str) -> None:
    """Let a sample have been made by another version of a module."""
    meta = json.loads((sample / "meta.json").read_text())
    meta["sources"][name] = "0" * 12
    (sample / "meta.json").write_text(json.dumps(meta))


def test_an_object_that_holds_never_breaks(tmp_path: Path) -> None:
    """Twelve frames: in the first ones the sudden start of the grips is more than 5 % of the work."""
    outcome = pipeline.run(compose(*SMALL, "capture.frames=12", f"output.folder={tmp_path}"))
    assert (outcome.status, outcome.finished) == ("never breaks", True)
    assert outcome.sample().complete


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        ("loading.offset=0.5", "loading.offset=0.5: the"),
        ("asset=mesh asset.path=gone.glb", "asset.path=gone.glb cannot be read"),
        ("solver.dt=0.05", "solver.dt=0.05"),
    ],
)
def test_a_scene_that_cannot_run_fails_with_its_message(
    overrides: str, reason: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    outcome = pipeline.run(compose(*SMALL, *overrides.split(), f"output.folder={tmp_path / 'out'}"))
    assert (outcome.status, outcome.path, outcome.frames, outcome.finished) == ("failed", None, 0, False)
    assert outcome.reason.startswith(reason)
    with pytest.raises(RuntimeError, match="="):
        outcome.sample()

    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.rglob("meta.json"))


def test_a_disk_that_fills_up_is_an_outcome_that_keeps_the_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add = recorder.Writer.add

    def full(writer: recorder.Writer, index: int, *frame: Any) -> None:
        if index == 2:
            raise OSError("output.folder=x: writing failed after 2 frames")
        add(writer, index, *frame)

    monkeypatch.setattr(recorder.Writer, "add", full)
    outcome = pipeline.run(compose(*SMALL, f"output.folder={tmp_path}"))
    assert (outcome.status, outcome.reason) == ("failed", "output.folder=x: writing failed after 2 frames")
    assert (outcome.frames, outcome.report) == (2, {})
    assert [outcome.path] == list(tmp_path.iterdir())
    assert outcome.path is not None
    assert outcome.path.name.endswith(".incomplete")


def test_a_programming_error_is_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, "build_of", None)
    with pytest.raises(TypeError):
        pipeline.run(Scene(output=compose(f"output.folder={tmp_path}").output))
    assert not list(tmp_path.iterdir())


def test_an_outcome_without_a_sample_raises_its_reason() -> None:
    with pytest.raises(RuntimeError, match="interrupted by the user"):
        Outcome("interrupted", Path("x"), "interrupted by the user").sample()


def test_a_scene_of_dataclasses_with_an_unknown_law_fails_with_its_message(tmp_path: Path) -> None:
    """`compose` has refused it before; a scene made in Python has not met `compose`."""
    outcome = pipeline.run(Scene(material=Material(law="jelly"), output=Output(folder=str(tmp_path))))
    assert (outcome.status, outcome.frames) == ("failed", 0)
    assert outcome.reason.startswith("material.law=jelly is not known")
