"""The table has one row a finished sample, equal to what the sample says, whatever happens while it is written."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from omegaconf import OmegaConf

from fracsim import compose, sample
from fracsim.dataset import captions, index
from fracsim.dataset.__main__ import main
from fracsim.dataset.table import COLUMNS, FIELDS, column_of, fingerprint
from fracsim.sample import schema
from fracsim.sample.identity import field_of
from fracsim.scene.classes import OBJECTS, TEST, TRAIN, class_of, split_of
from fracsim.scene.program import conf
from fracsim.scene.space import Space
from tests.command import environment

OLD = Path(__file__).parents[1] / "reference" / "version_1"


def by_object(folder: Path) -> dict[str, dict[str, Any]]:
    return {row["object"]: row for row in index.rows(folder)}


def test_train_and_test_share_no_object() -> None:
    assert not set(TRAIN) & set(TEST)
    assert set(TRAIN) | set(TEST) == {name for names in OBJECTS.values() for name in names}
    for names in OBJECTS.values():
        assert [split_of(name) for name in names] == ["train"] * 3 + ["test"] * 2
    assert (split_of("bar"), class_of("bar")) == ("none", "none")


def test_the_plan_of_table2_has_4212_and_2808_clips() -> None:
    """Every object has all draws of the table of its class, which is that of its material."""
    counts = dict.fromkeys(("train", "test"), 0)
    for kind, names in OBJECTS.items():
        table: Any = OmegaConf.to_container(OmegaConf.load(conf() / "space" / f"{kind}.yaml"))
        for name in names:
            counts[split_of(name)] += Space(**table).draws
            assert class_of(name) == class_of(compose(f"asset={name}").material.law) == kind
    assert counts == {"train": 4212, "test": 2808}


def test_rows_are_what_the_samples_say(folder: Path) -> None:
    rows = index.rows(folder)
    assert len(rows) == 4
    for row in rows:
        clip = sample.read(folder / row["path"])
        meta, report = clip.meta, clip.meta["report"]
        assert row["id"] == row["path"] == meta["id"]
        assert {field: row[column_of(field)] for field in FIELDS} == {f: field_of(clip.scene, f) for f in FIELDS}
        assert (row["object"], row["asset_kind"], row["seed"]) == (clip.scene.asset.name, "builtin", clip.scene.seed)
        for name in ("break_frame", "torn_frame", "particles", "substeps"):
            assert row[name] == report[name]
        assert [row["width"], row["height"]] == meta["size"]
        assert (row["frames"], row["fps"]) == (clip.frames, meta["fps"])
        assert row["bytes"] == sum(
            f.stat().st_size for f in clip.path.rglob("*") if f.is_file() and f.name != "meta.json"
        )
        assert row["seconds"] == pytest.approx(sum(meta["seconds"].values()))
        assert row["sha256"] == fingerprint(schema.inventory(clip.path))
        assert row["producer"] == f"fracsim {meta['provenance']['fracsim']}"
        assert row["caption"] == captions.caption(row)
        for column in COLUMNS:
            if column.name.endswith("_file_name") or column.name == "tracks_file":
                what = column.name.removesuffix("_file_name").removesuffix("_file")
                there = meta.get(what) or what in meta["maps"] or what == "tracks"
                assert (row[column.name] is not None) == bool(there)
                assert not there or (folder / row[column.name]).is_file()


def test_status_class_and_split(folder: Path) -> None:
    rows = by_object(folder)
    facts = {name: (r["status"], r["class"], r["split"], r["break_frame"], r["breaks_in_training"])
             for name, r in rows.items()}  # fmt: skip
    assert facts == {
        "bar": ("complete", "high_stretch", "none", 5, True),
        "duck": ("never breaks", "high_stretch", "train", None, False),
        "star": ("never breaks", "high_stretch", "test", None, False),
        "bread": ("suspect", "low_stretch", "test", None, False),
    }
    assert rows["bread"]["reason"].startswith("energy unaccounted")


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, "A duck of a rubber-like material that stretches far is pulled along an axis 30 degrees counter-clockwise "
             "from the horizontal and breaks."),
        ({"loading_axis_deg": -150.0, "break_frame": None},
         "A duck of a rubber-like material that stretches far is pulled along an axis 30 degrees counter-clockwise "
         "from the horizontal and holds."),
        ({"object": "bread", "class": "low_stretch", "loading_axis_deg": 270.0},
         "A loaf of bread of a soft material that stretches little is pulled vertically and breaks."),
        ({"object": "ice_cone", "class": "none", "loading_axis_deg": 180.0, "break_frame": None, "torn_frame": 3},
         "An ice cone is pulled horizontally."),
        ({"object": "object", "class": "none", "loading_axis_deg": None, "break_frame": None, "particles": None},
         "An object is pulled."),
    ],
)  # fmt: skip
def test_captions_claim_what_is_in_the_row(changes: dict[str, Any], text: str) -> None:
    row = {"object": "duck", "class": "high_stretch", "loading_axis_deg": 30.0, "break_frame": 9, "torn_frame": None,
           "particles": 100}  # fmt: skip
    assert captions.caption(row | changes) == text


def test_unchanged_samples_are_not_read_again(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And a table made piece by piece is the one made at once."""
    away = copy.parent / "away"
    last = max(p.name for p in copy.iterdir())
    shutil.move(copy / last, away)
    index.build(copy)
    assert pq.read_metadata(copy / "metadata.parquet").num_rows == 3
    shutil.move(away, copy / last)
    read, names = schema.read_meta, []
    monkeypatch.setattr(schema, "read_meta", lambda path: names.append(path.name) or read(path))
    index.build(copy)
    assert names == [last]
    piecewise = pq.read_table(copy / "metadata.parquet")
    (copy / "metadata.parquet").unlink()
    index.build(copy)
    assert pq.read_table(copy / "metadata.parquet").equals(piecewise)


def test_the_table_follows_the_samples(copy: Path) -> None:
    """A sample that is gone or has changed, one of another producer, a table of other columns, and one cut short."""
    first, second, *_ = sorted(p.name for p in copy.iterdir())
    path = index.build(copy)
    shutil.rmtree(copy / first)
    meta = json.loads((copy / second / "meta.json").read_text())
    (copy / second / "meta.json").write_text(json.dumps({**meta, "producer": "fracgen", "content": {"seed": 3.0}}))
    rows = {row["path"]: row for row in index.rows(copy)}
    assert set(rows) == {p.name for p in copy.iterdir() if p.is_dir()}
    assert (rows[second]["seed"], rows[second]["material_E"], rows[second]["status"]) == (3, None, "complete")
    assert pq.read_table(path).num_rows == 3
    pq.write_table(pa.table({"id": ["x"]}), path)
    assert len(index.rows(copy)) == pq.read_table(path).num_rows == 3
    path.write_bytes(path.read_bytes()[:100])
    assert len(index.rows(copy)) == pq.read_table(path).num_rows == 3


def test_what_is_not_finished_or_no_sample_has_no_row(copy: Path) -> None:
    """Being written, incomplete, damaged, other folders and files; such a sample gets its row when it is whole."""
    one, two, three, _ = sorted(p.name for p in copy.iterdir())
    (copy / one).rename(copy / f"{one}.partial-17.1@some.host")
    shutil.copytree(copy / two, copy / f"{two}.incomplete")
    (copy / three / "alpha.mkv").rename(copy / "alpha.mkv")
    for name in ("multirun", "failures", "notes"):
        (copy / name).mkdir()
    shutil.copytree(copy / two, copy / "multirun" / two)
    (copy / "sweep.jsonl").write_text("{}")
    assert len(index.rows(copy)) == 2
    (copy / f"{one}.partial-17.1@some.host").rename(copy / one)
    (copy / "alpha.mkv").rename(copy / three / "alpha.mkv")
    assert len(index.rows(copy)) == 4


KILLED = """
import os, signal, sys
import pyarrow.parquet as pq
from fracsim.dataset import index
write = pq.write_table

def cut(table, path, **options):
    write(table, path, **options)
    with open(path, "r+b") as file:
        file.truncate(100)
    os.kill(os.getpid(), signal.SIGKILL)

pq.write_table = cut
index.build(sys.argv[1])
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_process_killed_while_writing_leaves_the_old_table(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What it leaves besides is removed later."""
    path = index.build(copy)
    before = path.read_bytes()
    shutil.rmtree(min(p for p in copy.iterdir() if p.is_dir()))
    ended = subprocess.run([sys.executable, "-c", KILLED, str(copy)], env=environment())
    assert ended.returncode == -signal.SIGKILL
    assert path.read_bytes() == before
    (left,) = copy.glob(".metadata.parquet.*")
    index.build(copy)
    assert left.exists()
    os.utime(left, (0, 0))
    index.build(copy)
    assert not left.exists()
    assert pq.read_table(path).num_rows == 3


def test_a_sample_of_an_older_version_has_a_row(tmp_path: Path) -> None:
    """It has no content, so that its scene is asked."""
    shutil.copytree(OLD, tmp_path / "old")
    (row,) = index.rows(tmp_path / "old")
    assert (row["object"], row["material_E"], row["loading_speed"], row["rgb_file_name"] is None) == (
        "bar",
        6e3,
        4,
        False,
    )


def test_the_command_prints_classes_and_break_frames(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["index", str(copy)]) == 0
    heading, *lines, last = capsys.readouterr().out.splitlines()
    assert "break frame" in heading
    found = {line.split()[0]: line.split()[1:] for line in lines}
    # clips, train, test, none, complete, never breaks, suspect, least, median and most break frame, within training
    assert found == {
        "high_stretch": ["3", "1", "1", "1", "1", "2", "0", "5,", "5,", "5", "1"],
        "low_stretch": ["1", "0", "1", "0", "0", "0", "1", "none", "0"],
    }
    assert last == f"4 clips in {copy / 'metadata.parquet'}"


@pytest.mark.parametrize(("name", "complaint"), [("nowhere", "is not a folder"), ("", "holds no finished sample")])
def test_a_folder_without_samples(
    tmp_path: Path, name: str, complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["index", str(tmp_path / name)]) == 2
    assert complaint in capsys.readouterr().err
