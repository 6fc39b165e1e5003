"""A recorder in a process of its own does what one in the same process does, and its faults are told as theirs."""

import json
import os
import resource
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fracsim import compose, sample
from fracsim.run import pipeline
from fracsim.run.beside import Beside
from fracsim.run.outcome import Outcome
from tests.command import SMALL, samples
from tests.run.test_faults import check_incomplete, started


@pytest.fixture(autouse=True)
def always(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also for few frames, and on one core."""
    monkeypatch.setattr(pipeline, "_worthwhile", lambda scene: True)


def run(folder: Path, *overrides: str, beside: bool = True) -> Outcome:
    return pipeline.run(compose(*SMALL, f"output.folder={folder}", *overrides), beside=beside)


def handed_over(monkeypatch: pytest.MonkeyPatch, frame: int, do: Any) -> None:
    """Call `do` with the recorder before it gets a frame."""
    add = Beside.add

    def adding(recorder: Beside, given: Any) -> None:
        if given.index == frame:
            do(recorder)
        add(recorder, given)

    monkeypatch.setattr(Beside, "add", adding)


def test_the_sample_is_that_of_one_process(tmp_path: Path) -> None:
    extras = "capture.particles=true", "capture.gaussians=true", "camera.fov_deg=119"
    one, two = run(tmp_path / "one", *extras, beside=False), run(tmp_path / "two", *extras)
    assert (one.status, one.reason, one.frames) == (two.status, two.reason, two.frames)
    assert one.report == two.report
    assert any("camera.fov_deg=119" in warning for warning in two.report["warnings"])  # that of the film
    first, second = one.sample(), two.sample()
    assert {p.relative_to(first.path) for p in first.path.rglob("*")} == {
        p.relative_to(second.path) for p in second.path.rglob("*")
    }
    np.testing.assert_array_equal(first.rgb[:], second.rgb[:])
    np.testing.assert_array_equal(first.tracks.xy, second.tracks.xy)
    for name in first.maps:
        np.testing.assert_array_equal(first.maps[name][:], second.maps[name][:])
    for key in set(first.meta) - {"seconds", "provenance", "files"}:
        assert first.meta[key] == second.meta[key], key
    assert set(one.seconds) - set(two.seconds) == {"render", "write"}  # they passed meanwhile


def test_what_cannot_be_filmed_is_said_as_by_one_process_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    reasons = [run(tmp_path / "file" / "x", beside=beside).reason for beside in (False, True)]
    assert reasons[0] == reasons[1]
    assert "output.folder=" in reasons[0]
    (tmp_path / "bare.py").write_text("CHANNELS = 1\n")
    outcome = run(tmp_path / "out", f"capture.maps=[{tmp_path}/bare.py]")
    assert (outcome.status, outcome.path) == ("failed", None)
    assert "lacks UNIT, LABEL, SCALE, quantity" in outcome.reason
    assert not list((tmp_path / "out").glob("*"))


def test_an_error_while_it_films_ends_the_simulation_and_keeps_what_was_written(tmp_path: Path) -> None:
    """A map of the user that fails at frame 2."""
    (tmp_path / "late.py").write_text(
        "CHANNELS, UNIT, LABEL, SCALE = 1, '1', 'late', None\n"
        "def quantity(frame, axes):\n"
        "    if frame.index == 2:\n"
        "        raise ValueError('no value at frame 2')\n"
        "    return frame.d[:, None]\n"
    )
    outcome = run(tmp_path / "out", f"capture.maps=[{tmp_path}/late.py]", "capture.frames=40")
    assert (outcome.status, outcome.reason, outcome.frames) == ("failed", "no value at frame 2", 2)
    assert samples(tmp_path / "out") == [outcome.path]
    assert not sample.read(outcome.path, allow_incomplete=True).complete


def test_a_disk_that_fills_up_is_named_and_keeps_what_was_written(tmp_path: Path) -> None:
    """A limit on the size of a file stands for it; that of small pictures for the strip outgrows it first."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_300_000, limits[1]))  # more than what is reserved for the end
    try:
        outcome = run(tmp_path, "capture.frames=40")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert outcome.status == "failed"
    assert f"output.folder={tmp_path}: writing failed after {outcome.frames} frames" in outcome.reason
    assert 1 <= outcome.frames < 40
    assert sample.read(samples(tmp_path)[0], allow_incomplete=True).frames == outcome.frames


def test_the_end_of_the_simulation_keeps_all_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_: Beside) -> None:
        raise KeyboardInterrupt

    handed_over(monkeypatch, 3, interrupt)
    outcome = run(tmp_path)
    assert (outcome.status, outcome.frames) == ("interrupted", 3)
    assert check_incomplete(samples(tmp_path)[0], reason="interrupted by the user") == 3


def test_a_fault_of_the_simulation_leaves_no_other_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An error that is no outcome passes; frames are kept, and the process has gone."""
    found = []

    def fail(recorder: Beside) -> None:
        found.append(recorder._process)
        raise TypeError("a fault")

    handed_over(monkeypatch, 2, fail)
    with pytest.raises(TypeError, match="a fault"):
        run(tmp_path)
    assert found[0].poll() == 0
    assert check_incomplete(samples(tmp_path)[0], reason="killed, or failed without a word") == 2


def test_a_killed_recorder_is_named_with_a_way_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def kill(recorder: Beside) -> None:
        os.kill(recorder._process.pid, signal.SIGKILL)
        recorder._process.wait()

    handed_over(monkeypatch, 2, kill)
    outcome = run(tmp_path)
    assert (outcome.status, outcome.frames) == ("failed", 0)
    assert "ended with status -9" in outcome.reason
    assert "backend.threads=1" in outcome.reason
    (left,) = samples(tmp_path)
    assert not json.loads((left / "meta.json").read_text())["complete"]
    monkeypatch.undo()
    assert run(tmp_path, beside=False).sample().complete


def test_the_kill_of_the_simulation_lets_the_recorder_keep_its_frames(tmp_path: Path) -> None:
    if (os.cpu_count() or 1) < 2:
        pytest.skip("one core films in the same process")
    process = started(tmp_path)
    process.kill()
    process.communicate(timeout=60)  # until the other process has closed standard error, too
    assert check_incomplete(samples(tmp_path)[0], reason="its simulation was killed") >= 3
