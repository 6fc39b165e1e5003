"""Readers and `verify` notice everything that is wrong, and say what."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from fracsim import Scene, sample
from fracsim.sample import notebook
from fracsim.sample.__main__ import main

from .recording import FRAMES, Clip

Record = Callable[[Scene], Path]


def edit_meta(path: Path, **entries: object) -> None:
    meta = json.loads((path / "meta.json").read_text())
    (path / "meta.json").write_text(json.dumps(meta | entries))


@pytest.mark.parametrize(
    ("content", "complaint"),
    [(None, "is not a sample: it has no meta.json"), ("{", "damaged"), ("[]", "damaged"), ("{}", "damaged")],
)
def test_what_is_no_sample(tmp_path: Path, content: str | None, complaint: str) -> None:
    if content is not None:
        (tmp_path / "meta.json").write_text(content)
    with pytest.raises(ValueError, match=complaint):
        sample.read(tmp_path)
    assert complaint in sample.verify(tmp_path)[0]


def test_another_schema_version(scene: Scene, record: Record) -> None:
    path = record(scene)
    edit_meta(path, schema=99)
    with pytest.raises(ValueError, match="has schema version 99, but this fracsim reads versions 1 and 2"):
        sample.read(path)


def test_a_missing_file(scene: Scene, record: Record) -> None:
    path = record(scene)
    (path / "maps" / "flow.mkv").unlink()
    with pytest.raises(ValueError, match=r"is damaged: maps/flow\.mkv missing or cut short"):
        sample.read(path)
    assert sample.verify(path) == ["maps/flow.mkv is missing"]


def test_a_video_cut_short(scene: Scene, record: Record, clip: Clip) -> None:
    path = record(scene)
    whole = (path / "rgb.mkv").read_bytes()
    (path / "rgb.mkv").write_bytes(whole[: len(whole) * 3 // 5])
    with pytest.raises(ValueError, match=r"rgb\.mkv missing or cut short"):
        sample.read(path)
    left = sample.read(path, allow_incomplete=True)
    assert 0 < left.frames < FRAMES
    assert (left.rgb == clip.rgb[: left.frames]).all()
    assert len(left.maps["strain"]) == len(left.alpha) == len(left.tracks.xy) == left.frames


def test_a_damaged_video_of_the_right_size(scene: Scene, record: Record) -> None:
    path = record(scene)
    content = bytearray((path / "rgb.mkv").read_bytes())
    middle = len(content) // 2
    content[middle : middle + 50] = bytes(50)
    (path / "rgb.mkv").write_bytes(content)
    assert sample.verify(path) == ["rgb.mkv has changed"]
    with pytest.raises(ValueError, match=rf"rgb\.mkv is damaged: \d of {FRAMES} frames can be decoded"):
        _ = sample.read(path).rgb


def test_damaged_tracks(scene: Scene, record: Record) -> None:
    path = record(scene)
    (path / "tracks.npz").write_bytes(b"x" * (path / "tracks.npz").stat().st_size)
    with pytest.raises(ValueError, match=r"tracks\.npz is damaged"):
        _ = sample.read(path).tracks


def test_an_added_file_and_a_changed_scene(scene: Scene, record: Record) -> None:
    path = record(scene)
    (path / "notes.txt").write_text("mine")
    text = (path / "scene.yaml").read_text()
    (path / "scene.yaml").write_text(text.replace("seed: 0", "seed: 1"))
    assert sample.verify(path) == [
        f"scene.yaml is not the scene of {path.name}",
        "notes.txt is not part of the sample",
        "scene.yaml has changed",
    ]


def test_arrays_are_decoded_once(scene: Scene, record: Record) -> None:
    read = sample.read(record(scene))
    assert read.rgb is read.rgb
    assert read.maps["flow"] is read.maps["flow"]


KILLED = """
import os, signal, numpy as np
from fracsim import Camera, Capture, Output, Scene
from fracsim.sample import Writer, header_of
scene = Scene(capture=Capture(frames=9, maps=["flow"]), camera=Camera(width=64, height=48), output=Output(folder="."))
with Writer(header_of(scene), scene.output) as writer:
    for k in range(3):
        maps = {"flow": np.full((48, 64, 2), k, np.float32)}
        writer.add(k, np.full((48, 64, 3), k, np.uint8), np.ones((48, 64), np.float32), maps)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_killed_process_leaves_its_frames(tmp_path: Path) -> None:
    ended = subprocess.run([sys.executable, "-c", KILLED], cwd=tmp_path, env={**os.environ, "PYTHONPATH": _source()})
    assert ended.returncode == -signal.SIGKILL
    (path,) = tmp_path.iterdir()
    assert ".partial-" in path.name
    with pytest.raises(ValueError, match=r"is incomplete \(it is still being written, or its process was killed"):
        sample.read(path)
    left = _settled(path)
    assert left.frames == 3
    for k in range(3):
        assert (left.rgb[k] == k).all()
        assert left.maps["flow"][k] == pytest.approx(k, rel=1e-6)
    (path / "frames.jsonl").write_text((path / "frames.jsonl").read_text()[:-20])  # a line cut off
    assert sample.read(path, allow_incomplete=True).frames == 2
    assert sample.verify(path)[0].startswith("incomplete: it is still being written")


def _settled(path: Path) -> sample.Sample:
    """The sample once the encoders have seen the end of their input."""
    for _ in range(100):
        left = sample.read(path, allow_incomplete=True)
        if left.frames == 3:
            break
    return left


def _source() -> str:
    return str(Path(sample.__file__).parents[2])


def test_verify_on_the_command_line(scene: Scene, record: Record, capsys: pytest.CaptureFixture[str]) -> None:
    path = record(scene)
    assert main(["verify", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}: as it was written\n"
    (path / "tracks.npz").unlink()
    assert main(["verify", str(path), str(path.parent)]) == 1
    assert "tracks.npz is missing" in capsys.readouterr().out


def test_a_notebook_shows_the_film(tmp_path: Path) -> None:
    """Its bytes are part of the page; a film that is lost or too large is left out."""
    film = tmp_path / "strip.mp4"
    film.write_bytes(b"film")
    assert notebook.html("1 < 2", film) == (
        '<pre>1 &lt; 2</pre><video src="data:video/mp4;base64,ZmlsbQ==" controls loop muted '
        'style="max-width: 100%"></video>'
    )
    with film.open("wb") as file:
        file.truncate(notebook.MOST_BYTES + 1)
    assert notebook.html("x", film) == "<pre>x</pre>" == notebook.html("x", tmp_path / "lost.mp4")
