"""Samples of another producer than fracsim, and of an older version."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fracsim import Output, Scene, sample
from fracsim.sample import Header, MapInfo, Writer, map_infos
from fracsim.sample.video import decode
from fracsim.version import __version__

from .recording import FRAMES, HEIGHT, WIDTH, Clip

OLD = Path(__file__).parents[1] / "reference" / "version_1" / "903747a6c1ec"
"""Written by version 1 of the schema: 3 frames of 32 x 16, flow and damage."""
Record = Callable[[Scene], Path]


def generated(**changes: object) -> Header:
    """The header of a clip from a model that makes colour and maps, but no coverage, tracks or history."""
    entries = {
        "producer": "fracgen", "version": "0.3", "content": {"checkpoint": "ab12", "scene": "cd34", "seed": 7},
        "document": {"model": {"name": "tiny", "steps": 50}, "seed": 7},
        "width": WIDTH, "height": HEIGHT, "frames": FRAMES, "fps": 100.0,
        "maps": {**map_infos(["flow", "stress"]), "heat": MapInfo("heat", "K", 1, 300.0)},
        "about": {"device": "cpu"}, "packages": ("numpy", "no-such-package"),
    }  # fmt: skip
    return Header(**{**entries, **changes})  # type: ignore[arg-type]


def write(header: Header, clip: Clip, folder: Path) -> Path:
    maps = {"flow": clip.maps["flow"], "stress": clip.maps["stress"], "heat": 100 * clip.maps["damage"]}
    with Writer(header, Output(folder=str(folder))) as writer:
        for k in range(FRAMES):
            writer.add(k, clip.rgb[k], None, {name: maps[name][k] for name in header.maps})
        return writer.finish({"score": np.float32(0.5)})


def test_a_generated_clip_is_written_read_and_verified(clip: Clip, tmp_path: Path) -> None:
    header = generated()
    read = sample.read(write(header, clip, tmp_path))
    assert (read.path.name, read.producer, read.complete) == (header.id, "fracgen", True)
    assert sample.verify(read.path) == []
    assert np.array_equal(read.rgb, clip.rgb)
    assert set(read.maps) == {"flow", "stress", "heat"}
    assert np.array_equal(read.read("rgb", 2, 4), clip.rgb[2:4])
    assert np.abs(read.maps["heat"] - 100 * clip.maps["damage"]).max() <= 0.51 * 100 / 65535
    assert read.document == header.document
    assert read.meta["content"] == header.content
    assert (read.meta["maps"]["heat"]["unit"], read.meta["maps"]["heat"]["scale"]) == ("K", 300)
    assert (read.meta["device"], read.meta["report"]) == ("cpu", {"score": 0.5})
    assert "of fracgen, complete" in repr(read)


def test_what_a_generated_clip_lacks_is_named(clip: Clip, tmp_path: Path) -> None:
    read = sample.read(write(generated(), clip, tmp_path))
    for name, complaint in (
        ("alpha", "has no alpha: fracgen did not record it"),
        ("tracks", r"has no tracks\.npz"),
        ("history", r"has no history\.npz"),
        ("scene", "is not simulated but made by fracgen"),
    ):
        with pytest.raises(ValueError, match=complaint):
            getattr(read, name)


def test_the_provenance_is_that_of_the_producer(clip: Clip, tmp_path: Path) -> None:
    origin = sample.read(write(generated(), clip, tmp_path)).meta["provenance"]
    assert (origin["fracgen"], origin["fracsim"], origin["numpy"]) == ("0.3", __version__, np.__version__)
    assert origin["no-such-package"] is None
    assert "taichi" not in origin


def test_a_generated_clip_of_a_simulated_scene_has_a_place_of_its_own(clip: Clip, scene: Scene, record: Record) -> None:
    """The very content of the simulated sample, in the same folder."""
    simulated = record(scene)
    header = generated(content=sample.scene_content(scene))
    path = write(header, clip, Path(scene.output.folder))
    assert path != simulated
    assert sample.verify(path) == sample.verify(simulated) == []
    assert sample.find(scene.output, header.id) == path
    with pytest.raises(ValueError, match="already holds"):
        Writer(header, scene.output)


def test_a_strip_without_alpha_shows_all_pixels(clip: Clip, tmp_path: Path) -> None:
    path = write(generated(), clip, tmp_path)
    # Four panels of 64 x 48 with gaps of 4, under a title of 42: two lines, for names and scales do not fit into one.
    frames = decode(path / "strip.mp4", 4 * 68 + 4, 42 + 48 + 4, "rgb", 0, FRAMES)
    empty = frames[0, 44:50, 2 * 68 + 6 : 2 * 68 + 66].astype(int)  # stress is 0 there: dark violet, not white
    assert np.abs(empty - [68, 1, 84]).max() < 25


def test_a_changed_content_and_a_changed_document_are_found(clip: Clip, tmp_path: Path) -> None:
    path = write(generated(), clip, tmp_path)
    (path / "document.yaml").write_text("seed: 8\n")
    assert sample.verify(path) == ["document.yaml has changed"]
    meta = json.loads((path / "meta.json").read_text())
    meta["content"]["seed"] = 8.0
    (path / "meta.json").write_text(json.dumps(meta))
    assert sample.verify(path) == [f"content is not that of {path.name}", "document.yaml has changed"]


def test_a_map_cannot_have_the_name_of_a_picture() -> None:
    with pytest.raises(ValueError, match=r"maps=\['alpha'\]: alpha is no name for a map"):
        generated(maps={"alpha": MapInfo("alpha", "1", 1)})


def test_a_sample_of_version_1_is_read() -> None:
    read = sample.read(OLD)
    assert (read.producer, read.complete, read.frames) == ("fracsim", True, 3)
    assert (read.rgb.shape, read.alpha.shape) == ((3, 16, 32, 3), (3, 16, 32))
    assert {name: m.shape for name, m in read.maps.items()} == {"flow": (3, 16, 32, 2), "damage": (3, 16, 32, 1)}
    assert np.array_equal(read.read("flow", 1, 3), read.maps["flow"][1:])
    assert read.maps["damage"].max() > 0.1
    assert (read.scene.asset.name, read.tracks.xy.shape, len(read.history["t"])) == ("bar", (3, 4, 2), 3)
    assert read.document["loading"]["speed"] == 4
    assert "of fracsim, complete" in repr(read)


def test_a_sample_of_version_1_is_verified_by_its_hashes(tmp_path: Path) -> None:
    assert sample.verify(OLD) == []
    copy = shutil.copytree(OLD, tmp_path / OLD.name)
    (copy / "scene.yaml").write_text((copy / "scene.yaml").read_text().replace("seed: 0", "seed: 1"))
    assert sample.verify(copy) == ["scene.yaml has changed"]
