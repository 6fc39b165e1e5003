"""A folder of photos: each is pulled as its file says, failures are named, the sheet shows what there is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fracgen.wild import __main__ as program
from fracgen.wild import photos, roads
from fracgen.wild.sheet import CELL, LABEL, Row, sheet
from fracsim import compose
from fracsim.photo.stage import staged
from fracsim.sample.strip import GAP
from fracsim.scene import condition
from tests.photo import drawn


def test_photos_are_found_by_name_and_masks_are_none(tmp_path: Path) -> None:
    for name in ("b.JPG", "a.png", "a.mask.png", "c.webp"):
        drawn.save(tmp_path / name)
    (tmp_path / "notes.txt").write_text("no photo")
    assert [p.name for p in photos.found(tmp_path)] == ["a.png", "b.JPG", "c.webp"]


@pytest.mark.parametrize("empty", [True, False])
def test_a_folder_without_photos_is_named(empty: bool, tmp_path: Path) -> None:
    folder = tmp_path if empty else tmp_path / "nowhere"
    with pytest.raises(ValueError, match="holds no photo: give a folder of" if empty else "is not a folder, seen from"):
        photos.found(folder)


@pytest.mark.parametrize("preset", ["bread", "rubber"])
def test_a_plain_pull_is_the_default_scene(preset: str, tmp_path: Path) -> None:
    """Put into the scene again it gives the loading, the material and the thresholds of the defaults."""
    path = drawn.save(tmp_path / "loaf.png")
    one = photos.pulled(path, tmp_path / "out", preset)
    expected = compose(f"material={preset}", f"fracture={preset}")
    made = staged(compose("asset=image", f"asset.path={path}", f"condition={one.condition}"))
    assert made.material == expected.material
    assert made.fracture == expected.fracture
    assert made.loading.offset == pytest.approx(expected.loading.offset)
    assert made.loading.speed == pytest.approx(expected.loading.speed)
    assert made.loading.axis_deg == pytest.approx(0, abs=1e-9)


def test_a_file_beside_the_photo_comes_first(tmp_path: Path) -> None:
    path = drawn.save(tmp_path / "loaf.png")
    given = replace(photos.plain(path, "", "bread"), onset=1.9)
    condition.save(given, tmp_path / "loaf.json")
    assert photos.pulled(path, tmp_path / "out", "rubber").condition == tmp_path / "loaf.json"
    assert not (tmp_path / "out").exists()


def test_the_sample_is_the_last_folder_that_is_named(tmp_path: Path) -> None:
    lines = [
        "a warning about /elsewhere/0123",
        f"sample            {tmp_path}/abc123",
        f"to watch {tmp_path}/abc123/strip.mp4",
    ]
    assert roads._folder(lines, tmp_path) == tmp_path / "abc123"
    with pytest.raises(ValueError, match="no sample was named"):
        roads._folder(lines[:1], tmp_path)


SMALL = ("solver.cells=40", "capture.frames=5", "camera.width=64", "camera.height=48", "backend.threads=1",
         "capture.maps=[damage]")  # fmt: skip


def test_one_photo_is_torn_and_one_that_is_none_is_named(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Exit status 2, one line for the broken file, and a sheet with the other: photo, four times colour, damage."""
    drawn.save(tmp_path / "loaf.png")
    (tmp_path / "broken.png").write_bytes(b"no picture")
    out = tmp_path / "out"
    assert program.main([str(tmp_path), "--out", str(out), *SMALL]) == 2
    said = capfd.readouterr()
    assert "broken.png: asset.path=" in said.err
    assert "cannot be read as a picture" in said.err
    assert "1 of 2 photos failed" in said.err
    with Image.open(out / "sheet.png") as picture:
        assert picture.size == (6 * (CELL + GAP), CELL + LABEL + GAP)
    assert len(list((out / "simulated").glob("*/strip.mp4"))) == 1
    one = photos.pulled(tmp_path / "loaf.png", out / "conditions", "bread")
    sample = roads.simulate(one, out / "simulated", SMALL)  # found again
    rows = [Row(one.photo, sample, sample), Row(one.photo, sample, None)]
    with Image.open(sheet(rows, tmp_path / "both.png")) as picture:
        assert picture.size == (6 * (CELL + GAP), 3 * (CELL + LABEL + GAP))
        cells = np.asarray(picture)
    assert (cells[CELL + LABEL + GAP + 2 : 2 * CELL, :CELL] == 255).all()  # the photo is shown once


@pytest.mark.parametrize(("arguments", "message"), [
    (["DIR", "preview"], "preview is no FIELD=VALUE for the simulation"),
    (["DIR", "--generator", "vae=tiny"], "--generator vae=tiny has no effect without --run FOLDER"),
])  # fmt: skip
def test_options_that_say_nothing_are_refused(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        program.main([str(tmp_path) if a == "DIR" else a for a in arguments])
    assert message in capsys.readouterr().err
