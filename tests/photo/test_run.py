"""A photo and a condition file become a sample that needs neither to be read, and is found again."""

import json
from pathlib import Path

import numpy as np
import pytest

from fracgen import conditioning
from fracsim import compose
from fracsim.run import pipeline
from fracsim.run.attempt import Task
from fracsim.run.lines import label
from fracsim.sample import Sample, read
from fracsim.scene import condition
from fracsim.scene.condition import Condition
from tests.photo import drawn

PULL = Condition(grips=[0.34, 0.53, 0.57, 0.53], velocity=[-0.6, 0, 0.6, 0], E=4e3, onset=1.6, crit=2.4)
SMALL = ("solver.cells=40", "capture.frames=4", "camera.width=240", "camera.height=176", "backend.threads=1")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str], Sample]:
    """The folder of the photo, the command's overrides, and its sample."""
    folder = tmp_path_factory.mktemp("run")
    drawn.save(folder / "loaf.png")
    condition.save(PULL, folder / "pull.json")
    overrides = ["asset=image", f"asset.path={folder / 'loaf.png'}", f"condition={folder / 'pull.json'}",
                 "camera.background=photo", f"output.folder={folder / 'out'}", *SMALL]  # fmt: skip
    outcome = pipeline.run(compose(*overrides))
    assert outcome.path is not None, outcome.reason
    return folder, overrides, read(outcome.path)


def test_frame_0_is_the_photo(made: tuple[Path, list[str], Sample]) -> None:
    """Off the object exactly, but for the codec's rounding; on it as near as cells of 5 cm allow."""
    rgb = made[2].read("rgb", 0, 1)[0] / 255
    expected = drawn.picture(drawn.ellipse())[2:178] / 255
    near = drawn.ellipse(at=(110, 95, 76, 54))[2:178]
    assert np.abs(rgb - expected)[~near].max() < 4 / 255
    assert np.abs(rgb - expected)[near].mean() < 0.06


def test_the_object_parts_from_its_ground(made: tuple[Path, list[str], Sample]) -> None:
    """What it leaves is ground: nothing of its colour stays where it has gone."""
    first, last = (made[2].read("alpha", k, k + 1)[0] for k in (0, 3))
    left = (first > 0.8) & (last == 0)
    assert left.any() or (last > 0.8).sum() > (first > 0.8).sum()


def test_the_sample_needs_no_files(made: tuple[Path, list[str], Sample]) -> None:
    """Its scene has the camera, and the condition that it was made with, where the found object's centre has them."""
    folder, _, sample = made
    scene = sample.scene
    assert scene.condition == ""
    back = conditioning.of_scene(scene)
    assert (back.E, back.onset, back.crit) == (4e3, 1.6, 2.4)
    width = np.diff(np.reshape(back.grips, (2, 2))[:, 0])[0]
    assert width == pytest.approx(0.23, rel=0.01)
    assert json.loads((folder / "pull.json").read_text())["E"] == 4e3


def test_the_command_finds_its_sample_again(made: tuple[Path, list[str], Sample]) -> None:
    _, overrides, sample = made
    again = pipeline.run(compose(*overrides))
    assert (again.status, again.path) == ("existing", sample.path)


def test_a_sweep_calls_it_by_its_file(made: tuple[Path, list[str], Sample]) -> None:
    assert label(Task(compose(*made[1])), ()) == "loaf"
