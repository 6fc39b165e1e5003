"""What is written is what is read, file by file."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fracsim import Capture, Scene, sample
from fracsim.sample.video import decode

from .recording import FRAMES, HEIGHT, HISTORY, TRACKS, WIDTH, Clip, add, open_writer, tiny


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory, clip: Clip) -> tuple[Scene, Path]:
    """A complete sample with everything for people, too."""
    scene = tiny(tmp_path_factory.mktemp("full"), strip=True, report=True)
    with open_writer(scene) as writer:
        writer.track(clip.particles)
        add(writer, clip, scene)
        path = writer.finish({"break_frame": np.int64(3)}, HISTORY, {"simulate": 1.5})
    return scene, path


def test_folder_has_the_id_of_the_scene(full: tuple[Scene, Path]) -> None:
    scene, path = full
    assert path.name == sample.scene_id(scene)
    assert sample.find(scene.output, path.name) == path
    assert sample.verify(path) == []
    there = {p.relative_to(path).as_posix() for p in path.rglob("*") if p.is_file()}
    assert there == {
        "rgb.mkv", "alpha.mkv", "maps/flow.mkv", "maps/strain.mkv", "maps/stress.mkv", "maps/damage.mkv",
        "tracks.npz", "history.npz", "scene.yaml", "meta.json", "strip.mp4", "report.png",
    }  # fmt: skip
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_colour_is_lossless(full: tuple[Scene, Path], clip: Clip) -> None:
    assert (sample.read(full[1]).rgb == clip.rgb).all()


def test_alpha_is_kept_to_16_bits(full: tuple[Scene, Path], clip: Clip) -> None:
    alpha = sample.read(full[1]).alpha
    assert (alpha[clip.alpha == 0] == 0).all()
    np.testing.assert_allclose(alpha, clip.alpha, atol=0.51 / 65535)


@pytest.mark.parametrize("name", Capture().maps)
def test_maps_come_back_in_physical_units(full: tuple[Scene, Path], clip: Clip, name: str) -> None:
    read = sample.read(full[1])
    assert set(read.maps) == set(Capture().maps)
    values, raw = read.maps[name], clip.maps[name]
    assert values.shape == raw.shape
    assert values.dtype == np.float32
    assert (values[raw == 0] == 0).all()
    for k, c in np.ndindex(len(raw), raw.shape[-1]):
        lo, hi = read.meta["ranges"][name][k][c]
        np.testing.assert_allclose(values[k, ..., c], raw[k, ..., c], atol=0.51 * (hi - lo) / 65535)


def test_maps_can_be_read_without_this_package(full: tuple[Scene, Path], clip: Clip) -> None:
    # As documented: channels one above the other, value = lo + q / 65535 (hi - lo) with the ranges of meta.json.
    codes = decode(full[1] / "maps" / "flow.mkv", WIDTH, 2 * HEIGHT, "gray16", 0, FRAMES)
    lo, hi = sample.read(full[1]).meta["ranges"]["flow"][2][1]
    up = lo + codes[2, HEIGHT:] / 65535 * (hi - lo)
    np.testing.assert_allclose(up, clip.maps["flow"][2, ..., 1], atol=0.51 * (hi - lo) / 65535)


def test_tracks_and_curves(full: tuple[Scene, Path], clip: Clip) -> None:
    read = sample.read(full[1])
    assert read.tracks.xy.shape == (FRAMES, TRACKS, 2)
    assert (read.tracks.xy == clip.xy).all()
    assert (read.tracks.visible == clip.visible).all()
    assert (read.tracks.particles == clip.particles).all()
    assert {name: list(curve) for name, curve in read.history.items()} == HISTORY


def test_scene_can_be_loaded_again(full: tuple[Scene, Path]) -> None:
    scene, path = full
    assert sample.read(path).scene == scene
    assert sample.scene_id(sample.read(path).scene) == path.name


def test_meta_says_what_it_is_and_where_it_comes_from(full: tuple[Scene, Path], clip: Clip) -> None:
    meta = sample.read(full[1]).meta
    assert meta["complete"] is True
    assert (meta["frames"], meta["fps"], meta["size"]) == (FRAMES, 100, [WIDTH, HEIGHT])
    assert (meta["producer"], meta["document"]) == ("fracsim", "scene.yaml")
    assert meta["content"]["capture.frames"] == FRAMES
    assert (meta["view"]["width"], np.shape(meta["view"]["world_to_camera"])) == (WIDTH, (4, 4))
    assert meta["report"] == {"break_frame": 3}
    assert meta["seconds"] == {"simulate": 1.5}
    assert {"fracsim", "taichi", "numpy", "python", "platform", "git_commit", "git_dirty"} <= set(meta["provenance"])
    assert (meta["maps"]["flow"]["unit"], meta["maps"]["flow"]["channels"]) == ("m/s", 2)
    assert meta["maps"]["stress"]["scale"] == pytest.approx(clip.maps["stress"].max())
    assert meta["maps"]["flow"]["scale"] == pytest.approx(np.linalg.norm(clip.maps["flow"], axis=-1).max())
    assert meta["maps"]["damage"]["scale"] == 1  # its physical range, whatever the clip holds
    assert meta["maps"]["damage"]["largest"] == pytest.approx(clip.maps["damage"].max())


def test_pictures_for_people(full: tuple[Scene, Path]) -> None:
    strip = full[1] / "strip.mp4"
    # Five panels of 64 x 48 with gaps of 4, under a header of 24.
    frames = decode(strip, 5 * 68 + 4, 24 + 48 + 4, "rgb", 0, FRAMES)
    assert len(frames) == FRAMES
    assert frames[:, 24:72, 4:68].std() > 10
    with Image.open(full[1] / "report.png") as report:
        assert min(report.size) > 400


@pytest.mark.parametrize(
    ("rgb", "maps", "present"),
    [
        (False, ["stress"], {"alpha.mkv", "maps/stress.mkv"}),
        (True, [], {"alpha.mkv", "rgb.mkv"}),
        (False, [], set()),
    ],
)
def test_only_what_is_asked_for_is_written(
    tmp_path: Path, clip: Clip, rgb: bool, maps: list[str], present: set[str]
) -> None:
    scene = tiny(tmp_path, rgb=rgb, maps=maps, strip=True)
    with open_writer(scene) as writer:
        add(writer, clip, scene)
        path = writer.finish()
    assert {p.relative_to(path).as_posix() for p in path.rglob("*.mkv")} == present
    read = sample.read(path)
    assert sample.verify(path) == []
    assert set(read.maps) == set(maps)
    with pytest.raises(KeyError, match="map flow was not recorded"):
        read.maps["flow"]
    if not rgb:
        with pytest.raises(ValueError, match=r"capture\.rgb=false"):
            _ = read.rgb
    with pytest.raises(ValueError, match=r"history\.npz"):
        _ = read.history


def test_files_of_others_become_part_of_the_sample(scene: Scene, clip: Clip) -> None:
    with open_writer(scene) as writer:
        add(writer, clip, scene)
        (writer.folder / "particles").mkdir()
        (writer.folder / "particles" / "0000.npz").write_bytes(b"state")
        path = writer.finish()
    assert "particles/0000.npz" in sample.read(path).meta["files"]
    assert sample.verify(path) == []
