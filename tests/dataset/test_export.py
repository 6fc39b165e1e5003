"""Shards hold the very files of the samples, other libraries read them, and an interrupted export is continued."""

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fracsim.dataset
from fracsim import sample
from fracsim.dataset import webdataset_shards
from fracsim.dataset.__main__ import main
from fracsim.scene.classes import split_of
from tests.command import environment

from . import tiny

COUNT = 12
FIELDS = ("rgb.mkv", "alpha.mkv", "flow.mkv", "strain.mkv", "stress.mkv", "damage.mkv", "tracks.npz", "document.yaml",
          "meta.json")  # fmt: skip
SHARD = "300_000"
"""Bytes for about two clips."""


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.make(tmp_path_factory.mktemp("data"), COUNT)


@pytest.fixture(scope="module")
def shards(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("shards")
    assert export(clips, out) == 0
    return out


def export(clips: Path, out: Path, *options: str) -> int:
    return main(["export", str(clips), "--to", "webdataset", str(out), "--shard-bytes", SHARD, *options])


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def names(folder: Path, split: str = "*") -> list[str]:
    return sorted(str(path) for path in folder.glob(f"{split}-*.tar"))


def test_members_are_the_files_of_the_samples(clips: Path, shards: Path) -> None:
    index = json.loads((shards / "index.json").read_text())["shards"]
    keys = [key for shard in index for key in shard["keys"]]
    assert sorted(keys) == sorted(path.parent.name for path in clips.glob("*/meta.json"))
    assert [shard["name"] for shard in index] == [Path(name).name for name in names(shards)]
    assert len(index) >= 5
    for shard in index:
        path = shards / shard["name"]
        assert path.stat().st_size == shard["bytes"] <= int(SHARD)
        with tarfile.open(path) as tar:
            assert tar.getnames() == [f"{key}.{field}" for key in shard["keys"] for field in FIELDS]
            assert {member.mtime for member in tar} == {0}
            for key in shard["keys"]:
                assert "." not in key
                read = sample.read(clips / key)
                assert split_of(read.scene.asset.name) == shard["name"].partition("-")[0]
                for field, file in (("rgb.mkv", "rgb.mkv"), ("flow.mkv", "maps/flow.mkv"), ("tracks.npz", "tracks.npz"),
                                    ("document.yaml", "scene.yaml")):  # fmt: skip
                    member = tar.extractfile(f"{key}.{field}")
                    assert member is not None
                    assert member.read() == (read.path / file).read_bytes()


def test_webdataset_reads_them(clips: Path, shards: Path) -> None:
    av, webdataset = pytest.importorskip("av"), pytest.importorskip("webdataset")
    seen = 0
    for entry in webdataset.WebDataset(names(shards), shardshuffle=False).decode():
        read = sample.read(clips / entry["__key__"])
        facts = entry["meta.json"]
        assert facts["break_frame"] == (-1 if read.meta["report"]["break_frame"] is None else 3)
        assert facts["loading_speed"] == read.scene.loading.speed
        assert "is pulled" in facts["caption"]
        with av.open(io.BytesIO(entry["stress.mkv"])) as video:
            codes = np.stack([frame.to_ndarray(format="gray16le") for frame in video.decode(video=0)])
        lo, hi = np.array(facts["ranges"]["stress"])[:, 0].T  # of the only channel
        values = lo[:, None, None] + codes / 65535 * (hi - lo)[:, None, None]
        for frame, _, row, column, value in facts["outliers"]["stress"]:
            if frame != -1:
                values[int(frame), int(row), int(column)] = value
        np.testing.assert_allclose(values, read.maps["stress"][..., 0], rtol=1e-6, atol=1e-3)
        assert (entry["tracks.npz"]["xy"] == read.tracks.xy).all()
        seen += 1
    assert seen == COUNT


@pytest.mark.parametrize("streaming", [False, True])
def test_datasets_reads_them(shards: Path, tmp_path: Path, streaming: bool) -> None:
    """More clips than those from which it takes the types (5), the last with what the first do not have."""
    datasets = pytest.importorskip("datasets")
    files = {split: names(shards, split) for split in ("train", "test")}
    loaded = datasets.load_dataset("webdataset", data_files=files, streaming=streaming, cache_dir=str(tmp_path))
    rows: list[dict[str, Any]] = []
    for split in files:
        part = loaded[split].cast_column("rgb.mkv", datasets.Video(decode=False))
        for name in ("alpha", "flow", "strain", "stress", "damage"):
            part = part.cast_column(f"{name}.mkv", datasets.Video(decode=False))
        rows += list(part)
    assert len(rows) == COUNT
    assert {row["meta.json"]["split"] for row in rows} == {"train", "test"}
    assert sorted(row["meta.json"]["break_frame"] for row in rows) == [-1] * (COUNT - 1) + [3]
    assert all(len(row["meta.json"]["ranges"]["flow"]) == tiny.FRAMES for row in rows)
    assert sorted(row["meta.json"]["outliers"]["stress"] for row in rows) == [[[-1] * 4 + [0]]] * (COUNT - 1) + [
        [list(tiny.WILD)]
    ]
    assert all(row["rgb.mkv"]["bytes"][:4] == b"\x1aE\xdf\xa3" for row in rows)  # Matroska


KILLED = """
import os, signal, sys
from fracsim.dataset import webdataset_shards
from fracsim.dataset.__main__ import main
rename, left = os.replace, int(sys.argv[1])
def counted(old, new):
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    rename(old, new)
os.replace = counted
main(sys.argv[2:])
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize("renames", [1, 2, 5])
def test_killed_and_continued_gives_the_same_bytes(clips: Path, shards: Path, tmp_path: Path, renames: int) -> None:
    words = ["export", str(clips), "--to", "webdataset", str(tmp_path), "--shard-bytes", SHARD]
    killed = subprocess.run([sys.executable, "-c", KILLED, str(renames), *words], env=environment())
    assert killed.returncode == -signal.SIGKILL
    whole = contents(shards)
    assert all(whole[name] == data for name, data in contents(tmp_path).items() if name.endswith(".tar"))
    assert export(clips, tmp_path) == 0
    assert contents(tmp_path) == whole


def test_a_second_run_writes_nothing(clips: Path, shards: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.stat().st_mtime_ns for path in shards.glob("*.tar")}
    assert export(clips, shards) == 0
    assert f"0 shards written, {len(before)} were there" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in shards.glob("*.tar")} == before


def test_more_clips_give_the_shards_of_all(clips: Path, shards: Path, tmp_path: Path) -> None:
    """The same as if they had been there before, and no shard of the old plan is left."""
    grown, out = tmp_path / "grown", tmp_path / "out"
    shutil.copytree(clips, grown)
    removed = sorted(path.parent for path in grown.glob("*/meta.json"))[0]
    shutil.move(removed, tmp_path / removed.name)
    assert export(grown, out) == 0
    assert export(grown, out, "--verify") == 0
    shutil.move(tmp_path / removed.name, removed)
    assert export(grown, out, "--verify") == 1
    assert export(grown, out) == 0
    assert contents(out) == contents(shards)
    assert export(grown, out, "--only", "damage") == 0
    assert export(grown, out, "--verify") == 0
    assert sorted(path.name for path in out.glob("*.tar")) == sorted({Path(name).name for name in names(out)})
    with tarfile.open(names(out)[0]) as tar:
        assert {name.partition(".")[2] for name in tar.getnames()} == {"damage.mkv", "document.yaml", "meta.json"}


def test_verify_finds_what_is_wrong(
    clips: Path, shards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    shutil.copytree(shards, out)
    assert export(clips, out, "--verify") == 0
    first, second = (Path(name) for name in names(out)[:2])
    first.unlink()
    data = bytearray(second.read_bytes())
    data[len(data) // 2] ^= 1
    second.write_bytes(data)
    capsys.readouterr()
    assert export(clips, out, "--verify") == 1
    assert capsys.readouterr().out.splitlines() == [f"{first.name} is missing",
                                                    f"{second.name} has changed since it was written"]  # fmt: skip
    assert export(clips, tmp_path / "empty", "--verify") == 1


FULL = """
import resource, sys
from fracsim.dataset.__main__ import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
sys.exit(main(sys.argv[2:]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits of a process")
@pytest.mark.parametrize("most", [1_000, 30_000, 170_000])
@pytest.mark.parametrize("form", ["webdataset", "pack"])
def test_a_full_disk(clips: Path, tmp_path: Path, form: str, most: int) -> None:
    """One error that names OUT; no part of a shard or of a clip is left, and what is there is whole."""
    fracsim.dataset.open(clips)  # makes the table
    words = ["export", str(clips), "--to", form, str(tmp_path), "--shard-bytes", SHARD]
    failed = subprocess.run([sys.executable, "-c", FULL, str(most), *words], env=environment(), capture_output=True,
                            text=True)  # fmt: skip
    if form == "webdataset" or most < 30_000:
        assert failed.returncode == 2
        assert failed.stderr.startswith(f"error: OUT={tmp_path} cannot be written to (")
    assert len(failed.stderr.splitlines()) <= 1
    assert not list(tmp_path.glob("*partial*"))
    assert main(words) == 0
    assert main([*words, "--verify"]) == 0


def test_a_damaged_sample_stops_it_and_leaves_no_part(clips: Path, tmp_path: Path,
                                                      capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    broken, out = tmp_path / "broken", tmp_path / "out"
    shutil.copytree(clips, broken)
    path = sorted(broken.glob("*/maps/flow.mkv"))[0]
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert export(broken, out) == 2
    assert "flow.mkv has changed since it was written: run python -m fracsim.dataset verify" in capsys.readouterr().err
    assert not list(out.glob("*.partial"))


@pytest.mark.parametrize(("options", "complaint"), [
    (["--only", "depth"], "has no depth: all clips of an export have the same fields"),
    (["--size", "16"], "--size is for --to pack"),
    (["--shard-bytes", "1000"], "--shard-bytes 1000 is too small for clip"),
])  # fmt: skip
def test_what_cannot_be_exported(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str],
                                 complaint: str) -> None:  # fmt: skip
    assert export(clips, tmp_path, *options) == 2
    assert complaint in capsys.readouterr().err
    assert not names(tmp_path)


def test_all_clips_have_the_same_fields(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mixed = tmp_path / "mixed"
    shutil.copytree(clips, mixed)
    (scene,) = tiny.scenes(mixed, 1)
    scene.seed, scene.capture.maps = 99, ["damage"]
    tiny.record(scene, 0, broken=1)
    assert export(mixed, tmp_path / "out") == 2
    assert "Choose with --only from rgb,alpha,damage,tracks, which all have" in capsys.readouterr().err
    assert export(mixed, tmp_path / "out", "--only", "rgb,damage") == 0
    assert len(fracsim.dataset.open(mixed)) == COUNT + 1


def test_the_plan_does_not_depend_on_the_machine(clips: Path, shards: Path, tmp_path: Path) -> None:
    """Other times of files, another folder, an older index."""
    other = tmp_path / "other"
    shutil.copytree(clips, other)
    for path in other.rglob("meta.json"):
        os.utime(path, (1, 1))
    assert export(other, tmp_path / "out") == 0
    assert contents(tmp_path / "out") == contents(shards)
    assert webdataset_shards.load(tmp_path)["shards"] == []
