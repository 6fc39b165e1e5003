"""Nothing half-written passes for whole, and nothing whole is lost."""

import errno
import os
import shutil
from collections import namedtuple
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fracsim import Output, Scene, sample
from fracsim.sample.strip import Strip

from .recording import HISTORY, Clip, add, open_writer, tiny

Record = Callable[[Scene], Path]


def entries(scene: Scene) -> list[str]:
    folder = Path(scene.output.folder)
    return sorted(p.name for p in folder.iterdir()) if folder.exists() else []


def found(scene: Scene) -> Path | None:
    return sample.find(scene.output, sample.scene_id(scene))


def interrupted(scene: Scene, clip: Clip, error: BaseException) -> Path:
    """The sample left behind by an error after three frames."""
    with pytest.raises(type(error)):
        fail_after(3, scene, clip, error)
    identity = sample.scene_id(scene)
    assert entries(scene) == [f"{identity}.incomplete"]
    return Path(scene.output.folder) / f"{identity}.incomplete"


def fail_after(frames: int, scene: Scene, clip: Clip, error: BaseException) -> None:
    with open_writer(scene) as writer:
        add(writer, clip, scene, frames)
        raise error


@pytest.mark.parametrize("error", [RuntimeError("diverged at frame 3"), KeyboardInterrupt()])
def test_an_error_leaves_the_frames_until_then(scene: Scene, clip: Clip, error: BaseException) -> None:
    path = interrupted(scene, clip, error)
    with pytest.raises(ValueError, match=r"is incomplete \(.*allow_incomplete=True"):
        sample.read(path)
    left = sample.read(path, allow_incomplete=True)
    assert not left.complete
    assert type(error).__name__ in left.meta["reason"]
    assert str(error) in left.meta["reason"]
    assert left.frames == 3
    assert (left.rgb == clip.rgb[:3]).all()
    np.testing.assert_allclose(left.maps["stress"], clip.maps["stress"][:3], atol=0.06)
    assert (left.tracks.xy == clip.xy[:3]).all()
    assert found(scene) is None


def test_an_error_before_the_first_frame_leaves_nothing(scene: Scene, clip: Clip) -> None:
    with pytest.raises(RuntimeError):
        fail_after(0, scene, clip, RuntimeError())
    assert entries(scene) == []


def test_stopping_early_is_incomplete_with_its_reason(scene: Scene, clip: Clip) -> None:
    with open_writer(scene) as writer:
        add(writer, clip, scene, frames=2)
        path = writer.finish({"break_frame": None}, HISTORY, reason="a particle is too fast")
    assert path.name == f"{writer.id}.incomplete"
    left = sample.read(path, allow_incomplete=True)
    assert (left.frames, left.meta["reason"]) == (2, "a particle is too fast")
    assert sample.verify(path) == ["incomplete: a particle is too fast"]


def test_a_writer_that_is_not_finished_is_incomplete(scene: Scene, clip: Clip) -> None:
    with open_writer(scene) as writer:
        add(writer, clip, scene)
    assert entries(scene) == [f"{writer.id}.incomplete"]


def test_a_new_incomplete_one_takes_the_place_of_the_old(scene: Scene, clip: Clip) -> None:
    first = sample.read(interrupted(scene, clip, RuntimeError("first")), allow_incomplete=True)
    second = sample.read(interrupted(scene, clip, RuntimeError("second")), allow_incomplete=True)
    assert first.path == second.path
    assert "second" in second.meta["reason"]


def test_a_complete_one_clears_the_incomplete(scene: Scene, clip: Clip, record: Record) -> None:
    interrupted(scene, clip, RuntimeError())
    path = record(scene)
    assert entries(scene) == [path.name]


def test_a_whole_sample_is_not_made_again(scene: Scene, record: Record) -> None:
    path = record(scene)
    assert found(scene) == path
    with pytest.raises(ValueError, match=r"output\.folder=.* already holds .*output\.overwrite=true"):
        open_writer(scene)
    assert sample.verify(path) == []


def test_overwriting_waits_until_the_new_one_is_whole(scene: Scene, clip: Clip, record: Record) -> None:
    path = record(scene)
    before = (path / "meta.json").read_bytes()
    again = replace(scene, output=Output(folder=scene.output.folder, overwrite=True))
    with pytest.raises(RuntimeError):
        fail_after(3, again, clip, RuntimeError())
    assert (path / "meta.json").read_bytes() == before
    assert sample.verify(path) == []
    with open_writer(again) as writer:
        add(writer, clip, again)
        assert writer.finish({"run": 2}) == path
    assert sample.read(path).meta["report"] == {"run": 2}
    assert entries(scene) == [path.name]


def test_two_processes_may_make_the_same_sample(scene: Scene, clip: Clip, record: Record) -> None:
    with open_writer(scene) as slow:
        add(slow, clip, scene)
        path = record(scene)
        assert slow.finish({"slow": 1}) == path
    assert "slow" not in sample.read(path).meta["report"]
    assert entries(scene) == [path.name]


def test_a_damaged_sample_is_made_again(scene: Scene, record: Record) -> None:
    path = record(scene)
    (path / "alpha.mkv").unlink()
    assert found(scene) is None
    assert record(scene) == path
    assert sample.verify(path) == []


def test_a_place_that_cannot_be_written_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match=r"output\.folder=.*file/x cannot be written to \(.*: set output\.folder"):
        open_writer(tiny(tmp_path / "file" / "x"))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_place_without_permission_is_refused_at_once(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(ValueError, match=r"output\.folder=.*\(Permission denied\)"):
        open_writer(tiny(tmp_path))


def test_a_disk_without_room_is_refused_at_once(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10**9, 10**9 - 1000, 1000))
    with pytest.raises(ValueError, match=r"output\.folder=.* has 0 MB free, but this sample may need 1 MB"):
        open_writer(scene)
    assert entries(scene) == []


def test_a_disk_that_fills_up_is_one_clear_error(tmp_path: Path, clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = tiny(tmp_path, strip=True)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with open_writer(scene) as writer:
        add(writer, clip, scene, frames=2)
        monkeypatch.setattr(Strip, "add", full)
        maps = {name: m[2] for name, m in clip.maps.items()}
        with pytest.raises(OSError, match=r"output\.folder=.* failed after 2 frames.*No space left.*kept"):
            writer.add(2, clip.rgb[2], clip.alpha[2], maps, None)
    left = sample.read(tmp_path / f"{writer.id}.incomplete", allow_incomplete=True)
    assert left.frames == 2
    assert not list(left.path.glob("*.scratch"))


def test_an_encoder_that_dies_is_noticed(scene: Scene, clip: Clip) -> None:
    with open_writer(scene) as writer:
        writer._encoders["rgb"]._process.kill()
        writer._encoders["rgb"]._process.wait()
        with pytest.raises(OSError, match=r"output\.folder=.*encoder of rgb\.mkv ended"):
            add(writer, clip, scene)
    assert found(scene) is None


def test_a_map_that_is_not_finite_is_named(scene: Scene, clip: Clip) -> None:
    maps = {name: m[0].copy() for name, m in clip.maps.items()}
    maps["strain"][3, 4] = np.nan
    with open_writer(scene) as writer, pytest.raises(ValueError, match="map strain of frame 0: 1 of 3072 values"):
        writer.add(0, clip.rgb[0], clip.alpha[0], maps, None)


def test_an_unknown_map_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"capture\.maps=colour is not known.*damage, flow, strain, stress"):
        open_writer(tiny(tmp_path, maps=["colour"]))
