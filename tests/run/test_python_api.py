"""Six lines of Python: frames one by one, and pictures of any quantity."""

from pathlib import Path

import numpy as np
import pytest

import fracsim
from fracsim import Capture, Loading, Scene, Solver
from fracsim.records import Frame
from tests.command import SMALL


@pytest.fixture(scope="module")
def film() -> list[tuple[fracsim.Run, Frame]]:
    """All frames of a small scene, with their run."""
    run = fracsim.Run(fracsim.compose("asset=bar", *SMALL))
    return [(run, frame) for frame in run.frames()]


def test_the_six_lines_of_the_readme() -> None:
    """As they stand there, on a scene of two frames."""
    text = (Path(__file__).parents[2] / "README.md").read_text()
    code = text.partition("## From Python")[2].partition("```python\n")[2].partition("```")[0]
    code = code.replace('"quality=preview"', ", ".join(map(repr, (*SMALL, "capture.frames=2"))))
    assert code.count("capture.frames=2") == 1
    lines = [line for line in code.splitlines() if line and not line.startswith("import")]
    assert len(lines) <= 6
    names: dict[str, object] = {}
    exec(code, names)
    assert np.shape(names["image"]) == (64, 64, 1)


def test_frames_have_every_quantity(film: list[tuple[fracsim.Run, Frame]]) -> None:
    """Frame k is at t = k / fps and frame 0 at rest; grips have moved by v t, at 0.6 m/s."""
    n = len(film[0][0].particles)
    assert [frame.index for _, frame in film] == [0, 1, 2, 3]
    assert [frame.t for _, frame in film] == pytest.approx([0.0, 0.01, 0.02, 0.03])
    run, rest = film[0]
    assert np.abs(rest.x - run.particles.X).max() < 1e-6
    assert np.array_equal(rest.F, np.tile(np.eye(3, dtype=np.float32), (n, 1, 1)))
    _, last = film[-1]
    shapes = {"x": (n, 3), "v": (n, 3), "F": (n, 3, 3), "stress": (n, 3, 3), "d": (n,), "J": (n,)}
    for name, shape in shapes.items():
        value = getattr(last, name)
        assert value.shape == shape, name
        assert np.isfinite(value).all(), name
    assert last.d.min() >= 0
    assert last.d.max() <= 1
    right = run.particles.X[:, 0] - 1 > 0.13  # in the middle of the upper grip, 0.125 to 0.175
    right &= run.particles.X[:, 0] - 1 < 0.17
    assert (last.x - rest.x)[right, 0] == pytest.approx(0.6 * 0.03, abs=1e-5)
    assert last.stress[:, 0, 0].max() > 10 * abs(rest.stress).max()


def test_stress_is_that_of_cauchy(film: list[tuple[fracsim.Run, Frame]]) -> None:
    """sigma = tau / J, symmetric to the precision of float32."""
    _, last = film[-1]
    assert last.stress == pytest.approx(last.tau / last.J[:, None, None], rel=1e-5, abs=1e-3)
    assert np.abs(last.stress - last.stress.transpose(0, 2, 1)).max() < 1e-4 * np.abs(last.stress).max()


def test_a_picture_of_the_volume_change(film: list[tuple[fracsim.Run, Frame]]) -> None:
    """J is 1 at rest: its picture, premultiplied, is the coverage itself; (N,) gives one channel."""
    run, rest = film[0]
    image, alpha = run.render(rest, rest.J)
    assert (image.shape, alpha.shape) == ((64, 64, 1), (64, 64))
    assert image[..., 0] == pytest.approx(alpha, abs=1e-5)
    assert alpha.max() > 0.99
    assert alpha[0, 0] == 0  # nothing in the corner


def test_a_picture_of_a_quantity_of_one_s_own(film: list[tuple[fracsim.Run, Frame]]) -> None:
    """(N, 2): where a particle was along x, and a constant; their ratio is a position between the bar's ends."""
    run, _ = film[0]
    _, last = film[-1]
    X = run.particles.X[:, 0] - 1
    image, alpha = run.render(last, np.stack([X, np.full(len(X), 2.0)], axis=1))
    assert image.shape == (64, 64, 2)
    assert image[..., 1] == pytest.approx(2 * alpha, abs=1e-4)
    solid = alpha > 0.9
    where = image[..., 0][solid] / alpha[solid]
    columns = np.broadcast_to(np.arange(64), (64, 64))[solid]
    assert (where[columns < 20] < 0).all()  # the left of the picture was the left of the bar
    assert (where[columns > 44] > 0).all()
    assert np.abs(where).max() <= 0.3 + 1e-4


def test_without_a_quantity_it_is_the_colour(film: list[tuple[fracsim.Run, Frame]]) -> None:
    run, last = film[-1]
    image, alpha = run.render(last)
    assert image.shape == (64, 64, 3)
    assert (image <= alpha[..., None] * 1.5 + 1e-5).all()
    assert image.max() > 0.2


def test_the_report_counts_along(film: list[tuple[fracsim.Run, Frame]]) -> None:
    run, _ = film[-1]
    assert len(run.report.history.t) == 4
    assert run.report.summary()["substeps"] > 0


def test_a_scene_of_dataclasses_needs_no_files() -> None:
    """The same vocabulary without Hydra; a wrong value is an error as it is made."""
    scene = Scene(solver=Solver(cells=40), capture=Capture(frames=2, maps=[], rgb=False))
    assert [frame.index for frame in fracsim.Run(scene).frames()] == [0, 1]
    with pytest.raises(ValueError, match=r"loading\.speed=-1 is not allowed: it must be a number in \(0, 20\] m/s"):
        Loading(speed=-1)


def test_a_run_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = fracsim.Run(fracsim.compose("asset=bar", *SMALL, "capture.frames=2"))
    for frame in run.frames():
        run.render(frame)
    assert list(tmp_path.iterdir()) == []


def test_a_second_call_of_frames_begins_at_rest() -> None:
    """Also when the first one was not run to its end; equal frames, bit for bit with one thread."""
    run = fracsim.Run(fracsim.compose("asset=bar", *SMALL, "backend.threads=1"))
    first = [(frame.t, frame.x.copy()) for frame in run.frames()]
    half = iter(run.frames())
    next(half), next(half)
    again = [(frame.t, frame.x.copy()) for frame in run.frames()]
    assert [t for t, _ in again] == [t for t, _ in first]
    for (_, x), (_, y) in zip(first, again, strict=True):
        assert np.array_equal(x, y)
    assert len(run.report.history.t) == len(first)


def test_a_quantity_of_another_shape_is_refused(film: list[tuple[fracsim.Run, Frame]]) -> None:
    run, frame = film[0]
    with pytest.raises(ValueError, match=rf"quantity has shape \(3,\), but .*: \({len(frame.x)},\) or "):
        run.render(frame, frame.J[:3])


def test_dir_lists_what_the_pages_use() -> None:
    assert {"Run", "compose", "Scene"} <= set(dir(fracsim))
