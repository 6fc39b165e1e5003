"""The id names a scene: the same for what is the same, another for what is not."""

import hashlib
import json
import struct
import subprocess
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from fracsim import Asset, Backend, Capture, Fracture, Loading, Material, Output, Scene, Solver, compose
from fracsim.sample import sample_id, scene_content, scene_id
from fracsim.sample.header import header_of
from fracsim.sample.identity import canonical, pinned_defaults
from fracsim.sample.schema import load_scene, save_document
from fracsim.scene.knob import describe, knob

PINS = Path(__file__).parents[1] / "reference" / "pins.json"
"""Every field of a scene that counts -> its default when it entered."""


def test_id_is_12_hex_digits() -> None:
    assert len(scene_id(Scene())) == 12
    int(scene_id(Scene()), 16)


def test_where_it_runs_and_where_it_is_written_do_not_count() -> None:
    assert scene_id(Scene(backend=Backend(threads=7), output=Output(folder="x", overwrite=True))) == scene_id(Scene())


def test_a_label_does_not_count() -> None:
    """A preset and the same values by hand are one scene."""
    preset = compose("quality=preview")
    by_hand = replace(compose(), solver=preset.solver, camera=preset.camera, capture=preset.capture)
    assert (preset.quality, by_hand.quality) == ("preview", "default")
    assert scene_id(preset) == scene_id(by_hand) != scene_id(compose())


@pytest.mark.parametrize(
    "other",
    [
        Scene(seed=1),
        Scene(asset=Asset(name="duck")),
        Scene(fracture=Fracture(onset=1.6)),
        Scene(capture=Capture(frames=10)),
        Scene(loading=Loading(axis_deg=15)),
    ],
)
def test_everything_else_counts(other: Scene) -> None:
    assert scene_id(other) != scene_id(Scene())


def test_how_a_number_is_written_does_not_count() -> None:
    assert scene_id(Scene(loading=Loading(speed=1, axis_deg=0))) == scene_id(
        Scene(loading=Loading(speed=1.0, axis_deg=-0.0))
    )


def test_the_producer_counts() -> None:
    content = scene_content(Scene())
    assert sample_id("fracsim", content) == scene_id(Scene())
    assert sample_id("fracgen", content) != scene_id(Scene())


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), object(), {"a": [b"bytes"]}])
def test_content_that_json_cannot_hold_is_refused(bad: object) -> None:
    with pytest.raises(ValueError, match="the content of a fracgen sample cannot be hashed"):
        sample_id("fracgen", {"x": bad})


def test_an_object_counts_by_its_content(tmp_path: Path) -> None:
    for name, content in (("a.obj", "v 0 0 0"), ("b.obj", "v 0 0 0"), ("c.obj", "v 0 0 1")):
        (tmp_path / name).write_text(content)
    a, b, c = (scene_id(Scene(asset=Asset(kind="mesh", path=str(tmp_path / f"{n}.obj")))) for n in "abc")
    assert a == b != c


def test_a_lost_object_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"asset\.path=.*no\.ply cannot be read \(No such file"):
        scene_id(Scene(asset=Asset(kind="ply", path=str(tmp_path / "no.ply"))))


def test_every_pinned_default_is_in_the_list() -> None:
    """The ids of all samples depend on these values."""
    known, present = json.loads(PINS.read_text()), canonical(pinned_defaults(Scene))
    for name, value in present.items():
        assert name in known, (
            f"{name} is a new field. Choose the default that computes what was computed before the field, and append "
            f'"{name}": {json.dumps(value)} to {PINS.name}: older samples keep their ids.'
        )
        assert value == known[name], (
            f"the default of {name} has changed from {known[name]!r} to {value!r}. Set pinned={known[name]!r} in its "
            f"knob(...) and leave {PINS.name} alone: otherwise samples of the old and the new default get the same id."
        )
    gone = sorted(set(known) - set(present))
    assert not gone, f"{gone} have left the scene: remove them from {PINS.name}; samples that set them keep their ids."


def test_a_label_is_a_field() -> None:
    assert {name for name, _, _ in describe(Scene)} > {"quality"}
    assert "quality" not in pinned_defaults(Scene)


@dataclass(kw_only=True)
class LaterSolver(Solver):
    """A solver with a new field, and another default for an old one."""

    order: int = knob(1, "a field that did not exist")
    safety: float = knob(0.9, "was 0.8", least=0.01, most=1.0, pinned=0.8)


@dataclass(kw_only=True)
class LaterScene(Scene):
    """The scene of a later version."""

    solver: LaterSolver = field(default_factory=LaterSolver)


def test_a_new_field_leaves_ids_as_they_are() -> None:
    for material in (Material(), Material(E=1e4)):
        later = LaterScene(material=material, solver=LaterSolver(safety=0.8))
        assert scene_id(later) == scene_id(Scene(material=material))
    assert scene_id(LaterScene(solver=LaterSolver(safety=0.8, order=2))) != scene_id(Scene())


def test_a_changed_default_with_its_pin_keeps_the_ids_of_old_samples() -> None:
    """Both values of safety have the ids that they had before; 0.9 is the default now."""
    assert scene_id(LaterScene()) == scene_id(Scene(solver=Solver(safety=0.9)))
    assert scene_id(LaterScene(solver=LaterSolver(safety=0.8))) == scene_id(Scene())


def test_a_scene_survives_its_file(tmp_path: Path) -> None:
    scene = Scene(seed=3, loading=Loading(speed=1e-7, gravity=[0, -9.81, 0]), capture=Capture(maps=["stress"]))
    for solver in (replace(scene.solver, dt=1e-4), replace(scene.solver, dt="auto")):
        expected = replace(scene, solver=solver)
        save_document(header_of(expected).document, tmp_path / "scene.yaml")
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


def linked(folder: Path, name: str) -> tuple[Scene, list[Path]]:
    """A scene of a mesh with files beside it, named as their writers do, and these files."""
    folder.mkdir()
    texts = {
        "a.gltf": json.dumps({"buffers": [{"uri": "data%20file.bin"}], "images": [{"uri": "sub\\skin.png"}]}),
        "a.obj": "mtllib C:\\toys\\A B.mtl\nv 0 0 0\n",
        "a.ply": "ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 0\nend_header\n",
    }
    beside = {"a.gltf": ["data file.bin", "sub/skin.png"], "a.obj": ["a b.mtl", "skin.png"], "a.ply": ["skin.png"]}
    document = json.dumps({"images": [{"uri": "skin.png"}]}).encode()
    (folder / "a.glb").write_bytes(b"glTF" + struct.pack("<IIII", 2, 0, len(document), 0x4E4F534A) + document)
    (folder / "sub").mkdir()
    for file, content in texts.items():
        (folder / file).write_text(content)
    files = [folder / file for file in beside.get(name, ["skin.png"])]
    for file in files:
        file.write_text("newmtl m\nmap_Kd -s 1 1 1 skin.png\n" if file.suffix == ".mtl" else "one")
    return Scene(asset=Asset(kind="mesh", path=str(folder / name))), files


@pytest.mark.parametrize("name", ["a.gltf", "a.glb", "a.obj", "a.ply"])
def test_an_object_counts_by_the_files_that_it_refers_to(name: str, tmp_path: Path) -> None:
    """Buffers, pictures, material files and textures: another content, or none, is another object."""
    scene, files = linked(tmp_path / "one", name)
    copy, _ = linked(tmp_path / "two", name)
    before = scene_id(scene)
    assert before == scene_id(copy)
    seen = {before}
    for file in files:
        content = file.read_text()
        file.write_text(content + "\n# more")
        seen.add(scene_id(scene))
        file.unlink()
        seen.add(scene_id(scene))
        file.write_text(content)
    assert len(seen) == 1 + 2 * len(files)


def test_an_object_of_one_file_keeps_its_id(tmp_path: Path) -> None:
    """Its content is the sha256 of the file, as before; so it is where no file that it refers to is there."""
    for content in (b"v 0 0 0\n", b"mtllib lost.mtl\nv 0 0 0\n"):
        (tmp_path / "a.obj").write_bytes(content)
        scene = Scene(asset=Asset(kind="mesh", path=str(tmp_path / "a.obj")))
        assert scene_content(scene)["asset.path"] == hashlib.sha256(content).hexdigest()
