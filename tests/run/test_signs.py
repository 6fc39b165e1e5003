"""Signs of life of a run without a terminal: how far it is, and how long the rest will take."""

import pytest

from fracsim.run import console, signs
from fracsim.run.signs import Signs
from fracsim.scene.vocab import Scene


def test_a_line_now_and_then_tells_the_frame_and_the_time_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """101 frames at 100 a second: 20 of 100 frames took the 8 s since the first substep, so that 32 s are left."""
    clock = iter([0.0, 4.0, 12.0, 15.0, 22.1, 40.0])
    monkeypatch.setattr(signs.time, "monotonic", lambda: next(clock))
    run = Signs(101, 100.0)
    for t in (0.0, 0.2, 0.3, 0.5, 1.0):
        run.substeps(10, 1e-3, t)
    assert capsys.readouterr() == ("", "frame 21 of 101, 32 s left\nframe 51 of 101, 18 s left\n")


def test_notes_are_told_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    Signs(2, 100.0).note("compiling kernels")
    assert capsys.readouterr().err == "compiling kernels\n"


def test_without_a_terminal_there_are_signs_instead_of_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "OUT", console.Console(force_terminal=False))
    with console.progress(Scene()) as watch:
        assert isinstance(watch, Signs)
