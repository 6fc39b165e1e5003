"""What a failure leaves in a sweep: an exception, a full disk, a journal that cannot be written, a changed scene."""

import errno
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from fracsim import Scene, compose, sample
from fracsim.dataset import index
from fracsim.run import journal, pipeline, sweep
from fracsim.run.attempt import Task
from fracsim.run.outcome import Outcome
from fracsim.sample.schema import load_scene
from fracsim.sample.strip import Strip
from tests.command import SMALL


def test_an_exception_in_one_draw_does_not_stop_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Journal, scene and traceback are kept; the file goes when the scene succeeds."""
    good, bad = (compose(*SMALL, f"seed={seed}", f"output.folder={tmp_path}") for seed in (1, 2))
    run = pipeline.run

    def faulty(scene: Scene, watch: Any, beside: bool) -> Outcome:
        if scene.seed == 2:
            raise ZeroDivisionError("a fault of the program")
        return Outcome("complete", tmp_path, report={"break_frame": 3}, seconds={"simulate": 1.0}, frames=4)

    monkeypatch.setattr(pipeline, "run", faulty)
    summary = sweep.run_all([bad, Task(None, ("asset=bread", "material.E=1"), "material.E=1 is not allowed"), good])
    assert (summary.failed, summary.made, summary.counts.total()) == (2, 1, 3)
    entries = {entry["id"]: entry for entry in journal.read(tmp_path)}
    assert set(entries) == {sample.scene_id(good), sample.scene_id(bad)}
    assert entries[sample.scene_id(bad)]["reason"] == "ZeroDivisionError: a fault of the program"
    assert set(entries[sample.scene_id(good)]) == {"id", "status", "reason", "seconds", "wall", "host", "pid", "at",
                                                   "overrides"}  # fmt: skip
    (file,) = (tmp_path / "failures").iterdir()
    assert file.name == f"{sample.scene_id(bad)}.yaml"
    assert file.read_text().startswith("# ZeroDivisionError: a fault of the program\n# Traceback")
    assert asdict(load_scene(file)) == asdict(bad)
    monkeypatch.setattr(pipeline, "run", lambda *_: faulty(good, None, False))
    assert sweep.run_all([load_scene(file)]).made == 1
    assert not list((tmp_path / "failures").iterdir())
    monkeypatch.setattr(pipeline, "run", run)


def test_a_journal_that_cannot_be_written_stops_the_sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sweep.jsonl").mkdir()
    monkeypatch.setattr(pipeline, "run", lambda *_: Outcome("complete"))
    with pytest.raises(OSError, match="directory"):
        sweep.run_all([compose(*SMALL, f"output.folder={tmp_path}")] * 2)


def test_a_full_disk_fails_draws_not_samples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk fills up during the second of three draws: the first one stays whole, and with room the rest is made."""
    scenes = [compose(*SMALL, f"seed={seed}", f"output.folder={tmp_path}") for seed in (1, 2, 3)]
    fits = Strip.add
    frames = iter(range(1000))

    def filling(strip: Strip, *arguments: Any) -> None:
        if next(frames) >= 5:
            raise OSError(errno.ENOSPC, "No space left on device")
        fits(strip, *arguments)

    monkeypatch.setattr(Strip, "add", filling)
    summary = sweep.run_all(scenes)
    assert (summary.made, summary.failed) == (1, 2)
    first, *others = (sample.scene_id(scene) for scene in scenes)
    assert sample.verify(tmp_path / first) == []
    written = (tmp_path / first / "meta.json").stat().st_mtime_ns
    failures = [(tmp_path / "failures" / f"{name}.yaml").read_text() for name in others]
    assert all("No space left on device" in text for text in failures)
    monkeypatch.setattr(Strip, "add", fits)
    summary = sweep.run_all(scenes)
    assert (summary.counts["existing"], summary.made, summary.failed) == (1, 2, 0)
    assert (tmp_path / first / "meta.json").stat().st_mtime_ns == written
    assert [sample.verify(tmp_path / name) for name in others] == [[], []]
    assert not list((tmp_path / "failures").iterdir())


def test_a_changed_configuration_keeps_what_an_old_one_has_made(tmp_path: Path) -> None:
    """Samples of both lie side by side; neither is taken for the other, and the table has both."""
    old, new = (compose(*SMALL, f"material.E={E}", f"output.folder={tmp_path}") for E in (5e3, 6e3))
    assert sweep.run_all([old]).made == 1
    kept = (tmp_path / sample.scene_id(old) / "meta.json").read_bytes()
    assert sweep.run_all([new]).made == 1
    assert (tmp_path / sample.scene_id(old) / "meta.json").read_bytes() == kept
    assert sweep.run_all([old, new]).counts["existing"] == 2
    rows = index.table(tmp_path).select(["id", "material_E"]).to_pylist()
    assert {row["id"]: row["material_E"] for row in rows} == {sample.scene_id(old): 5e3, sample.scene_id(new): 6e3}


def test_torn_lines_of_a_journal_are_passed_over(tmp_path: Path) -> None:
    assert journal.read(tmp_path) == []
    (tmp_path / "sweep.jsonl").write_text('{"id": "a"}\n{"id": "b", "sta\n{"id": "c"}\n')
    assert [entry["id"] for entry in journal.read(tmp_path)] == ["a", "c"]
    follower = journal.Follower(tmp_path, len('{"id": "a"}\n'))
    assert (follower.count(), follower.count()) == (2, 2)
