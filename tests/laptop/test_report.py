"""The report of the laptop study: when and along which axis a clip tears, what the tables say, what the sheets show."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import fracsim.dataset
from fracgen.laptop import clips, sheets, tables
from fracgen.laptop.study import FULL
from tests.metrics.folders import FRAMES, HEIGHT, WIDTH, generated, truth


@pytest.mark.parametrize("angle", [0, 30, 90, 135])
def test_the_axis_of_two_pieces_is_the_line_through_them(angle: float) -> None:
    """Two discs 60 px apart; pixels are whole, so a degree is left."""
    rows, columns = np.mgrid[:96, :96]
    picture = np.ones((96, 96, 3))
    for sign in (-1, 1):
        x, y = 48 + sign * 30 * np.cos(np.radians(angle)), 48 - sign * 30 * np.sin(np.radians(angle))
        picture[(columns - x) ** 2 + (rows - y) ** 2 < 64] = 0.3
    assert clips.between(clips.axis(picture), angle) < 1


def test_angles_between_axes_know_that_0_and_180_degrees_are_one_axis() -> None:
    assert clips.between(179, 1) == pytest.approx(2)
    assert clips.between(0, 90) == pytest.approx(90)
    assert clips.between(30, 75) == pytest.approx(45)


def test_a_clip_is_torn_where_half_of_its_damage_is_there() -> None:
    video = np.zeros((5, 10, 10))
    video[2:, 0, 0], video[3:, 0, 1:4] = 1, 1
    assert clips.torn(video) == 3
    assert clips.torn(np.zeros((5, 10, 10))) is None


def test_a_sheet_has_a_true_and_a_generated_row_a_clip(tmp_path: Path) -> None:
    for seed in range(2):
        generated(tmp_path / "made", truth(tmp_path / "true", "duck", seed), look=seed)
    pairs = clips.both(str(tmp_path / "true"), str(tmp_path / "made"))
    assert [pair.made.sample.meta["content"]["clip"] for pair in pairs] == [pair.true.row["id"] for pair in pairs]
    with Image.open(sheets.sheet(pairs, tmp_path / "sheet.png")) as picture:
        across = sheets.MARGIN + 2 * sheets.COLUMNS * WIDTH + sheets.GAP
        assert picture.size == (across, 2 * 2 * HEIGHT + sheets.GAP)
    assert FRAMES >= sheets.COLUMNS
    with pytest.raises(ValueError, match="no generated clip"):
        sheets.sheet([], tmp_path / "empty.png")


def test_seconds_of_a_clip_are_the_sum_of_its_parts(tmp_path: Path) -> None:
    truth(tmp_path, "duck")
    assert clips.seconds(str(tmp_path)) == (1.0, len(fracsim.dataset.open(str(tmp_path))))


def scores(**of: list[float]) -> tables.Scores:
    """PSNR of the seeds of each variant."""
    return {name: [{"PSNR": value} for value in of[name]] for name in tables.NAMES}


FOUND = {"stage1": [10.0, 12.0], "stage2": [11.0, 11.0], "control": [13.0, 13.0], "stage3": [14.0, 15.0]}


def test_the_ablation_gives_means_with_the_range_of_the_seeds() -> None:
    row = next(line for line in tables.ablation(scores(**FOUND)).splitlines() if line.startswith("| PSNR"))
    assert row == "| PSNR ↑ | 11 [10, 12] | 11 [11, 11] | 13 [13, 13] | 14.5 [14, 15] | 20.73, 20.82, 21.19 |"


def test_directions_are_counted_by_seed_beside_those_of_the_paper() -> None:
    text = tables.directions(scores(**FOUND))
    assert text.splitlines()[2:] == ["| PSNR ↑ | better in 1 of 2; paper: better | better in 2 of 2; paper: better | "
                                     "better in 2 of 2 |"]  # fmt: skip


def test_scores_are_read_from_where_evaluations_put_them(tmp_path: Path) -> None:
    study = replace(FULL, folder=tmp_path, seeds=1)
    with pytest.raises(ValueError, match="holds no results"):
        tables.scores(study)
    found = {"metrics": {"psnr": {"results": {"psnr": {"value": 20.0}}}, "sac": {"results": {"sac": {"value": None}}}}}
    for variant in study.variants:
        folder = Path(study.path("scores", variant.place))
        folder.mkdir(parents=True)
        (folder / "metrics.json").write_text(json.dumps(found))
    assert tables.scores(study) == {name: [{"PSNR": 20.0}] for name in tables.NAMES}


def test_planned_figures_are_marked_as_such_and_guidance_doubles_them() -> None:
    rows = list(tables.planned())
    assert all("planned, not measured" in label for label, _ in rows)
    ten, twenty, fifty = (float(seconds) for _, seconds in rows)
    assert twenty == pytest.approx(2 * ten, rel=1e-3)  # four digits are printed
    assert fifty == pytest.approx(10 * ten, rel=1e-3)


def test_pulls_are_summed_up_in_a_sentence() -> None:
    """Axes are off by 0, 10, 20 and 10 degrees; early tears earlier in one of two pulls."""
    rows = [
        {"object": "bread", "axis": axis, "crit": crit, "true_axis": axis, "made_axis": made, "true_torn": 5,
         "made_torn": torn}
        for axis, crit, made, torn in ((0.0, 2.3, 0.0, 5), (0.0, 3.3, 170.0, None), (90.0, 2.3, 110.0, 7),
                                       (90.0, 3.3, 80.0, 7))
    ]  # fmt: skip
    assert tables.follows(rows).startswith("The longest axis of the last generated picture is 10°")
    assert "in 1 of 2 pulls" in tables.follows(rows)
    assert "| bread | 0° | 3.3 | 0° | 170° | 5 | whole |" in tables.pulls(rows)
