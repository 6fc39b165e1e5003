"""A data set is a lazy sequence that any process can read, without Taichi; and so do others."""

import json
import multiprocessing
import pickle
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fracsim.dataset
from fracsim import sample
from fracsim.dataset import Clip, Clips, index
from tests.command import python


@pytest.fixture(scope="module")
def clips(folder: Path) -> Clips:
    return fracsim.dataset.open(folder)


def names(clips: Clips) -> set[str]:
    return {clip.row["object"] for clip in clips}


def test_two_lines_read_a_clip(folder: Path) -> None:
    clips = fracsim.dataset.open(folder).filter(split="train", object="duck")
    stress = clips[0].read("stress", 2, 5)
    assert np.array_equal(stress, sample.read(folder / clips[0].row["path"]).maps["stress"][2:5])
    itself = clips[0].read("stress", 2, 5, over_alpha=True)
    assert np.array_equal(itself, sample.read(folder / clips[0].row["path"]).maps_over_alpha["stress"][2:5])
    assert clips[0].sample.complete


def test_it_is_a_sequence(clips: Clips) -> None:
    assert len(clips) == 3
    assert (
        [clip.row["id"] for clip in clips]
        == [clips[k].row["id"] for k in range(3)]
        == sorted(clips.table["id"].to_pylist())
    )
    assert clips[-1].row == clips[2].row
    part = clips[::2]
    assert isinstance(part, Clips)
    assert [clip.row["id"] for clip in part] == [clips[0].row["id"], clips[2].row["id"]]
    with pytest.raises(IndexError):
        clips[3]
    assert len(clips[3:]) == 0
    assert "3 clips of" in repr(clips)
    assert clips[0].row["caption"] in repr(clips[0])


def test_clips_are_filtered_by_columns_and_by_a_function(clips: Clips) -> None:
    assert names(clips.filter(object=["duck", "star"], split="test")) == {"star"}
    assert names(clips.filter(lambda row: row["loading_speed"] > 5)) == {"star"}
    assert names(clips.filter(lambda row: row["loading_speed"] == 4, **{"class": "high_stretch"})) == {"bar", "duck"}
    assert names(clips.filter(rgb_file_name=None)) == {"star"}
    assert len(clips.filter(object="whale")) == 0


def test_suspect_clips_are_apart(folder: Path, clips: Clips) -> None:
    assert names(clips) == {"bar", "duck", "star"}
    assert names(fracsim.dataset.open(folder, suspect=True)) == {"bar", "duck", "star", "bread"}


def test_an_unknown_column_is_named_with_the_one_that_was_meant(clips: Clips) -> None:
    with pytest.raises(ValueError, match=r"^material\.e is not a column of the table: did you mean material_E\?$"):
        clips.filter(**{"material.e": 1})
    with pytest.raises(ValueError, match=r"^colour is not a column of the table: choose one of id, object, "):
        clips.filter(lambda row: row["colour"] == 1)
    with pytest.raises(ValueError, match="did you mean break_frame"):
        clips[0].row["break_frames"]


def test_what_a_clip_lacks_is_named(clips: Clips) -> None:
    (star,) = clips.filter(object="star")
    with pytest.raises(ValueError, match=r"has no rgb: it was made with capture\.rgb=false"):
        star.read("rgb")


@pytest.mark.parametrize(("name", "complaint"), [("nowhere", "is not a folder"), ("", "holds no finished sample")])
def test_a_folder_without_samples(tmp_path: Path, name: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        fracsim.dataset.open(tmp_path / name)


def test_a_stale_table_is_made_again_and_a_read_only_folder_is_read(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(fracsim.dataset.open(copy)) == 3
    assert (copy / "metadata.parquet").is_file()
    shutil.rmtree(copy / fracsim.dataset.open(copy)[0].row["path"])

    def refuse(*_: Any) -> None:
        raise OSError("read-only file system")

    with monkeypatch.context() as patch:
        patch.setattr(index, "_save", refuse)
        assert len(fracsim.dataset.open(copy)) == 2
    before = (copy / "metadata.parquet").stat().st_mtime_ns
    assert len(fracsim.dataset.open(copy)) == 2
    assert (copy / "metadata.parquet").stat().st_mtime_ns > before


def stress_of(clip: Clip) -> float:
    return float(clip.read("damage", 3, 4).sum())


def test_clips_travel_to_other_processes(clips: Clips) -> None:
    again = pickle.loads(pickle.dumps(clips[1:]))
    assert [clip.row for clip in again] == [clip.row for clip in clips[1:]]
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        assert pool.map(stress_of, clips) == [stress_of(clip) for clip in clips]


def damage(batch: list[Clip]) -> list[float]:
    return [stress_of(clip) for clip in batch]


def test_a_data_loader_of_torch_reads_in_two_workers(clips: Clips) -> None:
    data = pytest.importorskip("torch.utils.data")
    loader = data.DataLoader(clips, batch_size=2, num_workers=2, collate_fn=damage)
    assert [value for batch in loader for value in batch] == [stress_of(clip) for clip in clips]


def test_reading_needs_no_taichi(folder: Path) -> None:
    code = f"""
import sys
import fracsim.dataset
clips = fracsim.dataset.open({str(folder)!r})
assert clips.filter(object="duck")[0].read("stress", 0, 2).shape == (2, 64, 64, 1)
print(*{{name.partition(".")[0] for name in sys.modules}})
"""
    assert not set(python(code).split()) & {"taichi", "torch", "trimesh", "scipy", "hydra", "matplotlib", "rich"}


def test_the_help_of_all_commands_needs_no_taichi() -> None:
    code = "import sys; from fracsim.dataset.__main__ import parser; parser().format_help(); print(*sys.modules)"
    assert not set(python(code).split()) & {"taichi", "torch"}


def test_the_working_folder_loads_as_a_videofolder(copy: Path, tmp_path: Path) -> None:
    """By `datasets`, in a process without fracsim; files that are no clips do not disturb it."""
    pytest.importorskip("datasets")
    table = index.table(copy)
    (copy / "failures").mkdir()
    (copy / "failures" / "0123456789ab.yaml").write_text("seed: 1")
    (copy / "sweep.jsonl").write_text('{"id": "x"}\n')
    (copy / "README.md").write_text("---\nlicense: other\n---\n")
    some = table["path"][0].as_py()
    shutil.copytree(copy / some, copy / f"{some}.partial-5@host")
    code = f"""
import json, os, sys
os.environ |= {{"HF_HOME": {str(tmp_path / "cache")!r}, "HF_HUB_OFFLINE": "1"}}
from datasets import Video, load_dataset
rows = load_dataset("videofolder", data_dir={str(copy)!r}, split="train")
videos = [name for name, feature in rows.features.items() if isinstance(feature, Video)]
for name in videos:
    rows = rows.cast_column(name, Video(decode=False))
trained = load_dataset("videofolder", data_dir={str(copy)!r}, split="train", filters=[("split", "==", "train")])
assert "fracsim" not in sys.modules
print(json.dumps([videos, rows.to_list(), trained["object"][:]]))
"""
    videos, rows, trained = json.loads(python(code).splitlines()[-1])
    assert videos == ["rgb", "alpha", "flow", "strain", "stress", "damage"]
    assert trained == ["duck"]
    for row, ours in zip(rows, table.to_pylist(), strict=True):
        for name in videos:
            path, there = ours.pop(f"{name}_file_name"), row.pop(name)
            assert (there and Path(there["path"])) == (path and copy / path)
        assert row == ours
