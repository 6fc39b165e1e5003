"""docs/files.md names every entry and array of a sample, and their formats are those on disk."""

import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fracsim.sample.video import FPS
from fracsim.solve.report import History
from tests.dataset import tiny

PAGE = (Path(__file__).parents[2] / "docs" / "files.md").read_text(encoding="utf-8")


def named(section: str) -> set[str]:
    """The names in the first column of the table of a section."""
    rows = PAGE.partition(f"## {section}\n")[2].partition("\n## ")[0]
    return {name for row in re.findall(r"^\| (`.*?) \|", rows, re.MULTILINE) for name in re.findall(r"`(.+?)`", row)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    (scene,) = tiny.scenes(tmp_path_factory.mktemp("out"), 1)
    return tiny.record(scene, 0, broken=3)


@pytest.fixture(scope="module")
def meta(folder: Path) -> Any:
    return json.loads((folder / "meta.json").read_text())


def test_every_key_of_meta_json_has_a_row(meta: Any) -> None:
    assert named("meta.json") == set(meta)


def test_keys_inside_are_named(meta: Any) -> None:
    for inner in (*meta["view"], *next(iter(meta["maps"].values()))):
        assert f"`{inner}`" in PAGE, inner
    assert f"version of this table, {meta['schema']}" in PAGE


def test_every_array_has_a_row(folder: Path) -> None:
    with np.load(folder / "tracks.npz") as tracks:
        assert named("tracks.npz") == set(tracks)
    assert named("history.npz") == {f.name for f in fields(History)}


def test_videos_have_the_format_and_the_rate_of_the_page(folder: Path, meta: Any) -> None:
    """FFV1 keeps rgb24 as gbrp or bgr0, the same numbers."""
    av = pytest.importorskip("av")
    width, height = meta["size"]
    for name, pixels, rows in (
        ("rgb", {"bgr0", "gbrp"}, 1),
        ("alpha", {"gray16le"}, 1),
        ("maps/flow", {"gray16le"}, 2),
    ):
        with av.open(str(folder / f"{name}.mkv")) as video:
            stream = video.streams.video[0]
            assert (stream.codec_context.name, stream.average_rate) == ("ffv1", FPS)
            assert stream.codec_context.pix_fmt in pixels
            assert (stream.width, stream.height) == (width, height * rows)
    assert f"at {FPS} frames a second" in PAGE
