"""A resolved configuration, as scene.yaml of a sample, run once more by its path."""

from pathlib import Path

import pytest
from omegaconf import OmegaConf

from fracsim import compose
from fracsim.sample.header import header_of
from fracsim.sample.schema import save_document
from tests.command import SMALL, fracsim_command, samples


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The file of a scene in which every section differs from the default one."""
    overrides = ("asset=duck", "material=rubber", "draw=3", "seed=5", "camera.azimuth_deg=20", *SMALL)
    save_document(header_of(compose(*overrides, f"output.folder={tmp_path}")).document, tmp_path / "scene.yaml")
    return tmp_path / "scene.yaml"


def test_the_file_of_a_scene_is_that_scene(file: Path) -> None:
    done = fracsim_command(str(file), "-c", "job", cwd=file.parent)
    assert (done.returncode, done.stderr) == (0, "")
    assert OmegaConf.create(done.stdout) == OmegaConf.load(file)


def test_fields_may_be_changed(file: Path) -> None:
    done = fracsim_command("material.E=12345", str(file), "-c", "job", cwd=file.parent)
    assert OmegaConf.create(done.stdout).material == {**OmegaConf.load(file).material, "E": 12345.0}


def test_it_finds_its_sample_and_leaves_nothing_else(tmp_path: Path) -> None:
    first = fracsim_command(*SMALL, "seed=5", f"output.folder={tmp_path / 'out'}")
    assert first.returncode == 0, first.stderr
    (path,) = samples(tmp_path / "out")
    again = fracsim_command(str(path / "scene.yaml"), cwd=tmp_path)
    assert (again.returncode, again.stderr) == (0, "")
    assert again.stdout == f"{path} is already there and whole; output.overwrite=true makes it again\n"
    other = fracsim_command("-m", str(path / "scene.yaml"), "seed=6,7", "capture.frames=1", cwd=tmp_path)
    assert (other.returncode, len(samples(tmp_path / "out"))) == (0, 3), other.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    ("content", "more", "said"),
    [
        ("seed: 1\nmateral: {E: 3}\n", (), "materal"),
        ("- 1\n", (), "is not a scene: it holds no fields"),
        ("a: [\n", (), "cannot be read as YAML"),
        ("seed: 1\n", ("asset=duck",), "asset=duck cannot be used with"),
    ],
)
def test_what_cannot_be_run_is_one_clear_error(content: str, more: tuple[str, ...], said: str, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(content)
    done = fracsim_command("mine.yaml", *more, "-c", "job", cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
