"""Loggers of a sweep: a row a clip on disk, and the same in wandb."""

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest

from fracsim import Scene
from fracsim.run import logger
from fracsim.run.outcome import Outcome
from fracsim.sample import read
from fracsim.sample.video import Encoder
from fracsim.scene.vocab import Asset, Material
from tests.command import SMALL, fracsim_command

STORED = Path(__file__).parents[1] / "reference/version_1/903747a6c1ec"
FAILED = Outcome("failed", None, "particle 3 flies off", seconds={"prepare": 0.1, "simulate": 0.4})
SCENES = Scene(asset=Asset(name="duck"), material=Material(E=2e4)), Scene(seed=1)


@pytest.fixture
def finished(tmp_path):
    """The outcome of a clip that is whole, with a preview video."""
    folder = tmp_path / "stored"
    shutil.copytree(STORED, folder)
    with Encoder(folder / "strip.mp4", 64, 32, "strip") as encoder:
        for shade in range(4):
            encoder.write(np.full((32, 64, 3), 60 * shade, np.uint8))
    meta = read(folder).meta
    report = {**meta["report"], "break_frame": 1}
    return Outcome("complete", folder, "", report, {"prepare": 0.1, "simulate": 2.0, "render": 0.5}, meta["frames"])


def _rows(folder):
    """The rows of the only table."""
    (path,) = (folder / "multirun").glob("*.csv")
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_csv_has_a_row_a_clip_at_once(tmp_path, finished):
    log = logger.make("csv", tmp_path, "smoke")
    for scene, outcome in zip(SCENES, (finished, FAILED), strict=True):
        log.log(outcome, scene)
    rows = _rows(tmp_path)
    log.close()
    log.close()
    assert [row["status"] for row in rows] == ["complete", "failed"]
    assert [row["asset.name"] for row in rows] == ["duck", "bread"]
    assert [row["material.E"] for row in rows] == ["20000", "6000"]
    assert [row["break_frame"] for row in rows] == ["1", ""]
    assert [float(row["seconds"]) for row in rows] == pytest.approx([2.6, 0.5])
    assert rows[1]["reason"] == "particle 3 flies off"
    assert len({row["id"] for row in rows}) == 2


def test_none_writes_nothing(tmp_path, finished):
    log = logger.make("none", tmp_path)
    log.log(finished, SCENES[0])
    log.close()
    assert not (tmp_path / "multirun").exists()


def test_an_unknown_logger_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"logger=tensorboard is not known: choose one of none, csv, wandb\."):
        logger.make("tensorboard", tmp_path)


def test_the_thumbnail_is_the_frame_of_the_break(finished):
    assert np.array_equal(logger.thumbnail(finished), read(finished.path).rgb[1])


def test_wandb_offline_has_the_curves_the_table_and_the_pictures(tmp_path, finished, monkeypatch):
    pytest.importorskip("wandb")
    for name in ("WANDB_API_KEY", "WANDB_MODE", "WANDB_DIR"):
        monkeypatch.delenv(name, raising=False)
    for name in ("CACHE", "CONFIG", "DATA"):
        monkeypatch.setenv(f"WANDB_{name}_DIR", str(tmp_path / name))
    log = logger.make("wandb", tmp_path, "smoke", total=4)
    for scene, outcome in zip(SCENES, (finished, FAILED), strict=True):
        log.log(outcome, scene)
    summary = log._run.summary
    assert summary["sweep/failed"] == summary["sweep/complete"] == 1
    assert summary["sweep/done"] == 2
    assert summary["sweep/seconds_left"] == pytest.approx(summary["sweep/seconds"])
    assert summary["seconds/simulate"] == 0.4
    log.close()
    (run,) = (tmp_path / "multirun/wandb").glob("offline-run-*")
    assert list(run.glob("*.wandb"))
    media = run / "files/media"
    assert [len(list(media.rglob(f"*{kind}"))) for kind in (".png", ".mp4", ".table.json")] == [1, 1, 1]
    assert len(_rows(tmp_path)) == 2


def test_a_multirun_writes_one_table_and_its_samples_do_not_know(tmp_path):
    """Three jobs in one process; a scene that fails is a row as well; logger=none leaves the ids as they are."""
    sweep = ("-m", *SMALL, "capture.frames=2", f"output.folder={tmp_path}", "loading.speed=0.5,0.7,600")
    assert fracsim_command(*sweep, "solver.max_speed=1000").returncode == 2
    rows = _rows(tmp_path)
    assert [row["loading.speed"] for row in rows if row["status"] != "failed"] == ["0.5", "0.7"]
    assert len({row["id"] for row in rows}) == len(rows)
    again = fracsim_command(*sweep, "solver.max_speed=1000", "logger=none")
    assert again.stdout.count("already there") == 2
