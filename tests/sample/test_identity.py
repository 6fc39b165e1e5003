"""The id names a scene: the same for what is the same, another for what is not."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from fracsim import Asset, Backend, Capture, Fracture, Loading, Output, Scene
from fracsim.sample import sample_id
from fracsim.sample.schema import load_scene, save_scene


def test_id_is_12_hex_digits() -> None:
    assert len(sample_id(Scene())) == 12
    int(sample_id(Scene()), 16)


def test_where_it_runs_and_where_it_is_written_do_not_count() -> None:
    assert sample_id(Scene(backend=Backend(threads=7), output=Output(folder="x", overwrite=True))) == sample_id(Scene())


@pytest.mark.parametrize(
    "other",
    [
        Scene(seed=1),
        Scene(quality="paper"),
        Scene(asset=Asset(name="duck")),
        Scene(fracture=Fracture(onset=1.6)),
        Scene(capture=Capture(frames=10)),
        Scene(loading=Loading(axis_deg=15)),
    ],
)
def test_everything_else_counts(other: Scene) -> None:
    assert sample_id(other) != sample_id(Scene())


def test_how_a_number_is_written_does_not_count() -> None:
    assert sample_id(Scene(loading=Loading(speed=1, axis_deg=0))) == sample_id(
        Scene(loading=Loading(speed=1.0, axis_deg=-0.0))
    )


def test_an_object_counts_by_its_content(tmp_path: Path) -> None:
    for name, content in (("a.obj", "v 0 0 0"), ("b.obj", "v 0 0 0"), ("c.obj", "v 0 0 1")):
        (tmp_path / name).write_text(content)
    a, b, c = (sample_id(Scene(asset=Asset(kind="mesh", path=str(tmp_path / f"{n}.obj")))) for n in "abc")
    assert a == b != c


def test_a_lost_object_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"asset\.path=.*no\.ply cannot be read \(No such file"):
        sample_id(Scene(asset=Asset(kind="ply", path=str(tmp_path / "no.ply"))))


def test_a_scene_survives_its_file(tmp_path: Path) -> None:
    scene = Scene(seed=3, loading=Loading(speed=1e-7, gravity=[0, -9.81, 0]), capture=Capture(maps=["stress"]))
    for solver in (replace(scene.solver, dt=1e-4), replace(scene.solver, dt="auto")):
        expected = replace(scene, solver=solver)
        save_scene(expected, tmp_path / "scene.yaml")
        assert load_scene(tmp_path / "scene.yaml") == expected


def test_a_file_that_is_no_scene_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text("asset:\n  colour: red\n")
    with pytest.raises(ValueError, match=r"scene\.yaml is not a scene of this version.*colour"):
        load_scene(tmp_path / "scene.yaml")


def test_neither_samples_nor_maps_load_taichi_or_matplotlib() -> None:
    program = (
        "import sys, fracsim.sample, fracsim.maps; print([m for m in ('taichi', 'matplotlib') if m in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"
