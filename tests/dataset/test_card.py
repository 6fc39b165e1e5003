"""The card says what the table says, and its code runs."""

import json
import re
import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from omegaconf import OmegaConf
from PIL import Image

from fracsim.dataset import card, index
from fracsim.dataset.__main__ import main
from fracsim.dataset.histogram import histogram
from fracsim.sample.schema import read_meta
from tests.command import python


def head(text: str) -> Any:
    """The YAML head that hubs read."""
    return OmegaConf.to_container(OmegaConf.create(text.split("---\n")[1]))


def text_of(folder: Path, **options: str) -> str:
    return card.write(folder, **options).read_text()


def test_the_head_is_what_hubs_read(copy: Path) -> None:
    found = head(text_of(copy))
    assert (found["license"], found["size_categories"]) == ("apache-2.0", ["n<1K"])
    assert found["task_categories"] == ["image-to-video", "text-to-video"]
    assert [config["config_name"] for config in found["configs"]] == ["all", "train", "test"]
    assert [card._size(n) for n in (999, 1000, 7020, 100_000, 20_000_000)] == [
        "n<1K", "1K<n<10K", "1K<n<10K", "100K<n<1M", "10M<n<100M"]  # fmt: skip


def test_counts_are_those_of_the_table(copy: Path) -> None:
    text = text_of(copy)
    assert "| bar | high_stretch | none | 1 | 1 | 0 | 0 |" in text
    assert "| bread | low_stretch | test | 1 | 0 | 0 | 1 |" in text
    assert "| all | | test | 2 | 0 | 1 | 1 |" in text
    assert "Class high_stretch: 1 of 3 clips break, 1 of them within the 81 frames of training" in text
    assert "Class low_stretch: 0 of 1 clips break" in text
    assert re.search(
        r"`loading_speed`: speed of each grip \[m/s\]\n\n```text\n0\.6 +#+ +1\n +4 +#+ +2\n +8 +#+ +1\n", text
    )
    assert "`material_density` 200.0 kg/m^3" in text
    assert "draws failed" not in text
    size = sum(row["bytes"] for row in index.rows(copy))
    assert f"{size / 1e9:.3g} GB, {size / 4e6:.3g} MB a clip" in text


def test_the_origin_is_that_of_the_samples_and_the_journal(copy: Path) -> None:
    (copy / "failures").mkdir()
    (copy / "failures" / "ab.yaml").write_text("seed: 1")
    lines = ({"id": k, "status": "complete", "overrides": [f"draw={k}", "solver.cells=40"]} for k in "ab")
    (copy / "sweep.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    text = text_of(copy)
    made = read_meta(copy / index.rows(copy)[0]["path"])["provenance"]
    assert (
        f"4 clips by fracsim {made['fracsim']}. The first one: fracsim {made['fracsim']}, taichi {made['taichi']}"
        in text
    )
    assert "All attempts in `sweep.jsonl` had `solver.cells=40` in common." in text
    assert "1 draws failed" in text


def test_a_licence_is_given_for_objects_from_elsewhere(copy: Path) -> None:
    assert "Apache-2.0, as fracsim" in text_of(copy)
    assert head(text_of(copy, license="cc-by-4.0"))["license"] == "cc-by-4.0"
    path = copy / index.rows(copy)[0]["path"]
    meta = json.loads((path / "meta.json").read_text())
    meta["content"] |= {"asset.kind": "mesh", "asset.path": "ab" * 32}
    (path / "meta.json").write_text(json.dumps(meta))
    (path / "scene.yaml").write_text((path / "scene.yaml").read_text().replace("path: ''", "path: toys/my_toy.glb"))
    meta["files"]["scene.yaml"]["bytes"] = (path / "scene.yaml").stat().st_size
    (path / "meta.json").write_text(json.dumps(meta))
    assert head(text_of(copy))["license"] == "other"
    assert "my_toy" in {row["object"] for row in index.rows(copy)}


def test_the_sheet_has_a_picture_of_each_clip(copy: Path) -> None:
    text = text_of(copy)
    assert "![one frame of 4 clips](sheets/thumbnails.png)" in text
    picture = Image.open(copy / "sheets" / "thumbnails.png")
    assert picture.size == (4 * 128, 128 + 14)
    for k in range(4):
        tile = picture.crop((128 * k, 14, 128 * (k + 1), 142)).convert("L")
        assert len(np.unique(np.asarray(tile))) > 5


def test_equal_samples_give_equal_cards(copy: Path) -> None:
    first = text_of(copy)
    assert text_of(copy) == first


def test_every_column_is_explained(copy: Path) -> None:
    text = text_of(copy)
    assert set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)) == set(index.table(copy).column_names)


def test_the_code_on_the_card_runs(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs, shards = re.findall(r"```python\n(.*?)```", text_of(copy), re.DOTALL)
    monkeypatch.chdir(copy.parent)
    python(ours + "\nassert len(frames) == 8")
    pytest.importorskip("datasets")
    monkeypatch.setenv("HF_HOME", str(copy.parent / "cache"))
    assert python(theirs).startswith("1 ['id', 'object', ")
    if find_spec("fracsim.dataset.export") is None or find_spec("webdataset") is None:
        pytest.skip("no shards")
    (star,) = (row["path"] for row in index.rows(copy) if row["object"] == "star")
    shutil.rmtree(copy / star)  # in shards all clips have the same maps
    assert main(["export", copy.name, "--to", "webdataset", "shards"]) == 0
    (duck,) = (row for row in index.rows(copy) if row["object"] == "duck")
    assert python(shards) == f"{duck['id']} {duck['caption']}\n"


def test_the_head_makes_a_hub_load_each_split(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder given as that of a data set, without the name of a builder."""
    pytest.importorskip("datasets")
    card.write(copy)
    monkeypatch.setenv("HF_HOME", str(copy.parent / "cache"))
    code = f"""
from datasets import load_dataset
for name in ("all", "train", "test"):
    split, rows = load_dataset({str(copy)!r}, name).popitem()
    print(name, split, *sorted(rows["object"]))
"""
    assert python(code).splitlines() == ["all train bar duck star", "train train duck", "test test star"]


def test_a_histogram_has_a_line_a_value_or_an_interval() -> None:
    assert histogram([2.0, 1.5, 2.0]) == [f"1.5  {'#' * 20:<40}  1", f"  2  {'#' * 40}  2"]
    lines = histogram(list(range(100)))
    assert [line.split("  ")[-1] for line in lines] == ["10"] * 10
    assert lines[0].startswith("    0 to 9.9  ")
    assert histogram([]) == []


def test_the_command_prints_where_the_card_lies(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.rmtree(copy / "sheets", ignore_errors=True)
    assert main(["card", str(copy), "--license", "mit"]) == 0
    assert capsys.readouterr().out == f"{copy / 'README.md'}\n"
