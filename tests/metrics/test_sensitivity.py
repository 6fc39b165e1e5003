"""`python -m fracgen.sensitivity`: clips made wrong in one way, pairs of clips that differ in one field, the tables."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fracgen.config.sensitivity import SensitivityConfig, Tables
from fracgen.evaluation import sources
from fracgen.evaluation.clip import ALPHA, TRACKS, Clip
from fracgen.sensitivity import alter, report, study
from fracgen.sensitivity.__main__ import SENSITIVITY
from fracgen.sensitivity.cases import ABOUT, FIELDS, cases, partner
from fracsim import Camera, Capture, Output, Scene
from fracsim.dataset.progress import silent
from fracsim.scene.vocab import Fracture, Loading, Material
from tests.dataset import tiny
from tests.metrics.folders import METRIC, arrays

CHANGES = {
    "twin": {"seed": 1},
    "axis": {"loading": replace(Loading(), axis_deg=60.0)},
    "speed": {"loading": replace(Loading(), speed=2.0)},
    "thresholds": {"fracture": replace(Fracture(), onset=2.0, crit=3.0)},
    "stiffness": {"material": replace(Material(), E=1e4)},
}
"""What is different in the other clip of a pair."""


@pytest.fixture(scope="module", name="folder")
def folder_fixture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene, five that differ from it in one thing, and one that differs in two; random pictures, 32 x 48 px."""
    folder = tmp_path_factory.mktemp("clips")
    two = {**CHANGES["axis"], **CHANGES["stiffness"]}
    camera = Camera(width=tiny.WIDTH, height=tiny.HEIGHT)
    for look, change in enumerate([{}, *CHANGES.values(), two]):
        capture = Capture(frames=tiny.FRAMES, tracks=3, report=False, strip=False)
        scene = Scene(capture=capture, camera=camera, output=Output(folder=str(folder)), **change)
        tiny.record(scene, look, broken=None)
    return folder


def config(folder: Path, **changes: object) -> SensitivityConfig:
    return SensitivityConfig(data=str(folder), outside=[METRIC], **changes)


def clip() -> Clip:
    """Six frames of 32 x 48 px, random."""
    rgb, alpha, maps = arrays(0, 6, 32, 48)
    videos = {"rgb": rgb, ALPHA: alpha, TRACKS: None, **maps, "stress": maps["stress"] / 5e3}
    return Clip("a", 6, 32, 48, 100.0, {name: lambda v=v: v for name, v in videos.items()})


def test_a_partner_differs_in_its_field_and_in_nothing_else(folder: Path) -> None:
    found = sources.folder(str(folder), "data", False).sources
    default = {"seed": 0, "loading_axis_deg": Scene().loading.axis_deg, "material_E": Scene().material.E,
               "loading_speed": Scene().loading.speed, "fracture_onset": Scene().fracture.onset}  # fmt: skip
    (plain,) = (one for one in found if all(one.row[name] == value for name, value in default.items()))
    for name, columns in FIELDS.items():
        other = partner(plain, found, columns)
        assert other is not None, name
        assert {c for c in default if other.row[c] != plain.row[c]} == set(columns) - {"fracture_crit"}
    number = found.index(plain)
    assert [case.name for case in cases(number, found, config(folder))] == [
        *(name for name in ABOUT if name not in ("other maps", "exchanged")), "exchanged", "other maps"]  # fmt: skip


def test_a_late_clip_holds_its_first_frame_and_a_frozen_one_keeps_it() -> None:
    a = clip()
    late, frozen = alter.late(a, 2), alter.frozen(a)
    for name in ("rgb", "damage", ALPHA):
        video = a.get(name)
        assert np.array_equal(late.get(name), np.concatenate([video[:1], video[:1], video[:-2]]))
        assert (frozen.get(name) == video[:1]).all()
    assert not late.has(TRACKS), "tracks would tell where material was"


def test_blur_keeps_the_mean_and_noise_has_the_deviation_that_is_asked_for() -> None:
    """Of a constant picture nothing is blurred. Bytes are rounded, which adds 1/12 to the variance of the noise."""
    a = clip()
    plain = Clip("b", 6, 32, 48, 100.0, {"rgb": lambda: np.full((6, 32, 48, 3), 120, np.uint8)})
    assert (alter.blurred(plain, 2.0).rgb == 120).all()
    assert alter.blurred(a, 2.0).rgb.std() < 0.2 * a.rgb.std(), "white noise blurred by 2 px keeps 1 / (4 pi 2^2) of it"
    noise = alter.noisy(plain, 0.05, 0).rgb.astype(float) - 120
    assert noise.std() == pytest.approx(np.sqrt((0.05 * 255) ** 2 + 1 / 12), rel=0.02)
    assert np.array_equal(alter.noisy(plain, 0.05, 0).rgb, alter.noisy(plain, 0.05, 0).rgb)
    stress = alter.noisy(a, 0.5, 0).map("stress")
    assert 0 <= stress.min()
    assert stress.max() <= 1


def test_maps_are_exchanged_or_those_of_another_clip() -> None:
    a, b = clip(), alter.frozen(clip())
    exchanged = alter.exchanged(a)
    assert np.array_equal(exchanged.map("strain"), a.map("stress"))
    assert np.array_equal(exchanged.map("damage"), a.map("strain"))
    assert np.array_equal(exchanged.map("flow"), a.map("flow"))
    foreign = alter.maps_of(a, b)
    assert np.array_equal(foreign.map("damage"), b.map("damage"))
    assert np.array_equal(foreign.rgb, a.rgb)


def test_the_tables_have_every_case_and_true_clips_agree_with_themselves(folder: Path, tmp_path: Path) -> None:
    """Of seven clips each has a partner for the case that made it, two for the clip that others came from."""
    found = study.run(config(folder), silent)
    lines = {line.case: line for line in found if line.result == "difference"}
    assert set(lines) == set(ABOUT)
    assert lines["itself"].value == lines["other maps"].value == lines["exchanged"].value == 0, "a metric of colour"
    assert lines["frozen"].value > 0
    assert {name: line.n for name, line in lines.items() if name in FIELDS} == {
        "twin": 2, "axis": 4, "speed": 2, "thresholds": 2, "stiffness": 4}  # fmt: skip
    table, page = report.write(found, tmp_path / "out")
    rows = list(csv.DictReader(table.open()))
    assert rows[0] == {"case": "itself", "metric": "brightness", "result": "difference", "value": "0", "n": "7",
                       "better": "lower"}  # fmt: skip
    assert "| `difference` ↓ | 0 |" in page.read_text()
    assert "`largest`" not in page.read_text(), "it has no direction"
    assert not list((tmp_path / "out").glob(".*"))


def test_what_cannot_be_measured_is_said_once(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fields = {"brightness": {"weights": "lamp"}}
    assert study.run(config(folder, metric=fields, limit=1), silent) == []
    assert capsys.readouterr().err.count("no brightness: the lamp (1 MB) was not found") == 1


def test_a_folder_without_clips_is_refused_with_the_way_out(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"data= is empty: .*\+sweep=sensitivity"):
        study.run(SensitivityConfig(output=Tables(folder=str(tmp_path))), silent)
    with pytest.raises(ValueError, match="holds neither finished samples nor videos"):
        study.run(config(tmp_path), silent)


def test_the_command_composes_with_its_defaults() -> None:
    cfg = SENSITIVITY.compose("data=clips", "metric.psnr.cap=50")
    assert {"psnr", "ssim", "map_mse"} <= set(cfg.metric)
    assert cfg.metric["psnr"]["cap"] == 50
