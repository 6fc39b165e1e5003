"""A pixel with a wild value, in a sample: exact in every way of reading it, and older samples read as before."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fracsim import Scene, sample
from fracsim.sample import schema

from .recording import FRAMES, Clip, add, open_writer

WILD = {"stress": [(1, 20, 20, 0, 1e9)], "flow": [(2, 15, 30, 1, -3e5), (4, 12, 13, 0, 7e4)]}
"""Frame, row, column, channel and value of wild pixels."""


@pytest.fixture
def wild(clip: Clip) -> Clip:
    """The clip with a few wild pixels."""
    maps = {name: values.copy() for name, values in clip.maps.items()}
    for name, pixels in WILD.items():
        for *at, value in pixels:
            maps[name][tuple(at)] = value
    return replace(clip, maps=maps)


def close(read: sample.Sample, wild: Clip, frames: int = FRAMES) -> None:
    """Wild pixels are exact, and the others have the digits that they would have without them."""
    for name, pixels in WILD.items():
        values, raw = read.maps[name][:frames].astype(float), wild.maps[name][:frames]
        for *at, value in pixels:
            if at[0] < frames:
                assert values[tuple(at)] == value
        usual = np.abs(np.where(np.abs(raw) > 5e4, 0, raw)).max()  # 7 kPa and 1.5 m/s
        np.testing.assert_allclose(values, raw, rtol=1e-7, atol=0.51 * 2 * usual / 65535)


def write(scene: Scene, wild: Clip) -> Path:
    with open_writer(scene) as writer:
        add(writer, wild, scene)
        return writer.finish({"break_frame": 3})


def test_wild_pixels_are_exact_and_the_others_keep_their_digits(scene: Scene, wild: Clip) -> None:
    read = sample.read(write(scene, wild))
    close(read, wild)
    assert read.meta["schema"] == 3
    assert read.meta["outliers"]["stress"] == [[1, 0, 20, 20, 1e9]]
    assert read.meta["outliers"]["strain"] == []
    about = read.meta["maps"]
    assert (about["stress"]["largest"], about["flow"]["largest"]) == (1e9, pytest.approx(3e5))
    assert about["stress"]["scale"] == pytest.approx(7e3, rel=0.1)  # what is not wild
    assert about["flow"]["scale"] < 3
    assert sample.verify(read.path) == []


def test_frames_of_a_sample_with_wild_pixels_are_those_of_the_whole(scene: Scene, wild: Clip) -> None:
    read = sample.read(write(scene, wild))
    for name in WILD:
        for start in range(FRAMES):
            assert (read.read(name, start, start + 1) == read.maps[name][start : start + 1]).all()


def test_wild_pixels_survive_an_interruption(scene: Scene, wild: Clip) -> None:
    """One that the writer sees, and one that leaves nothing but the journal."""
    with open_writer(scene) as writer:
        add(writer, wild, scene, frames=3)
    (left,) = Path(scene.output.folder).glob("*.incomplete")
    close(sample.read(left, allow_incomplete=True), wild, frames=3)
    meta = json.loads((left / schema.META).read_text())
    ranges, outliers = ({name: meta[m][name] for name in meta["maps"]} for m in ("ranges", "outliers"))
    lines = [json.dumps({"ranges": {name: ranges[name][k] for name in ranges},
                         "outliers": {name: [at for at in outliers[name] if at[0] == k] for name in outliers}})
             for k in range(3)]  # fmt: skip
    (left / schema.JOURNAL).write_text("\n".join(lines) + "\n")
    schema.write_meta(left, {**meta, "frames": 0, "ranges": {}, "outliers": {}})
    close(sample.read(left, allow_incomplete=True), wild, frames=3)


def test_the_journal_holds_wild_pixels_while_a_sample_is_written(scene: Scene, wild: Clip) -> None:
    with open_writer(scene) as writer:
        add(writer, wild, scene, frames=2)
        lines = (writer.folder / schema.JOURNAL).read_text().splitlines()
    assert json.loads(lines[1])["outliers"]["stress"] == [[1, 0, 20, 20, 1e9]]


@pytest.mark.parametrize("complete", [True, False])
def test_samples_of_version_2_are_read_as_before(
    scene: Scene, record: Callable[[Scene], Path], clip: Clip, complete: bool
) -> None:
    path = record(scene)
    meta = json.loads((path / schema.META).read_text())
    values = sample.read(path).maps["stress"]
    del meta["outliers"]
    old = {**meta, "schema": 2}
    if not complete:  # killed while it was written: the ranges are in the journal
        lines = [{name: meta["ranges"][name][k] for name in meta["maps"]} for k in range(FRAMES)]
        (path / schema.JOURNAL).write_text("".join(json.dumps(line) + "\n" for line in lines))
        old |= {"complete": False, "reason": "killed", "frames": 0, "ranges": {}, "files": {}}
    schema.write_meta(path, old)
    read = sample.read(path, allow_incomplete=True)
    assert read.meta["schema"] == 2
    assert read.frames == FRAMES
    assert (read.maps["stress"] == values).all()
    assert (read.maps_over_alpha["stress"][read.alpha < 0.05] == 0).all()
