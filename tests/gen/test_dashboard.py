"""The workspaces of wandb show what the loggers log, and nothing else; they are made without a network."""

import csv
import json
import re
from typing import get_args

import pytest

from fracgen import dashboard, vae
from fracgen.train import TRAIN
from fracgen.training import stages
from fracgen.training.runs import METRICS
from fracsim.run import logger
from fracsim.run.outcome import Outcome, Status
from fracsim.scene.vocab import Scene
from tests.gen import trainings

pytest.importorskip("wandb_workspaces")

TABLE = "val/clips"
"""Of clips; only wandb gets it."""


class Wandb:
    """A stand-in for the package wandb that keeps the names that are logged."""

    def __init__(self) -> None:
        self.logged, self.summary, self.settings = set(), {}, {}

    def init(self, **settings):
        return self

    def Settings(self, **settings):
        return settings

    def Table(self, columns, log_mode):
        return self

    def Image(self, picture, caption):
        return picture

    Video = Image

    def define_metric(self, *names, **options):
        pass

    def add_data(self, *values):
        pass

    def log(self, values):
        self.logged |= set(values)

    def finish(self):
        pass


def test_every_name_of_the_sweep_is_one_that_the_logger_of_a_sweep_logs(tmp_path, monkeypatch):
    import sys

    fake = Wandb()
    monkeypatch.setitem(sys.modules, "wandb", fake)
    log = logger.make("wandb", tmp_path, "smoke", total=9)
    seconds = dict.fromkeys(logger.PHASES, 1.0)
    report = {"break_frame": 1, "torn_frame": None, "particles": 10, "substeps": 20}
    monkeypatch.setattr(log, "_pictures", lambda outcome, identity: dict.fromkeys(logger.PICTURES, "picture"))
    for status in get_args(Status):
        log.log(Outcome(status, None, "", report, seconds, 4), Scene())
    log.close()
    assert set(dashboard.keys(dashboard.sweep())) <= fake.logged
    assert dashboard.SWEEP_AXIS in fake.logged


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """The names that a training with all streams, all losses and the default metrics logs."""
    place = tmp_path_factory.mktemp("dashboard")
    latents = trainings.cache(place / "latents", about={"vae": vae.identity_of(TRAIN.compose("vae=tiny").vae)})
    more = ("stage=3", "init_from=none", "model.train=lora", "model.lora.rank=2", "vae=tiny", "measure.clips=2",
            "logger.videos=1", "logger.video_steps=1")  # fmt: skip
    (run,) = stages.run(trainings.config(place / "runs", latents, *more))
    with (run.folder / METRICS).open(newline="") as file:
        return set(next(csv.reader(file)))


def _levels(names):
    """Names without the bin of noise levels that they may end in: a short run draws few of the bins."""
    return {
        name.rpartition("/")[0] if name[-1].isdigit() and "-" in name.rpartition("/")[2] else name for name in names
    }


def test_every_name_of_training_is_one_that_training_logs(names):
    shown = {key for key in dashboard.keys(dashboard.train()) if key != TABLE}
    assert _levels(shown) <= _levels(names)


def test_everything_that_training_logs_is_shown(names):
    """But for further results of metrics by class and object, for which wandb makes panels by itself."""
    missing = _levels(names) - {"step", "val/passes"} - _levels(dashboard.keys(dashboard.train()))
    assert not {name for name in missing if not _matched(name) and not re.fullmatch(r"val/(bread|star)/\w+", name)}


def test_every_pattern_of_training_matches_what_training_logs_by_object_too(names):
    for pattern in dashboard.patterns(dashboard.train()):
        there = names | {"val/sac"}  # undefined of noise
        assert any(re.search(pattern, name) for name in there), pattern
    assert _matched("val/bread/mse")
    assert not _matched("val/loss/total"), "losses have panels of their own"


def _matched(name):
    return any(re.search(pattern, name) for pattern in dashboard.patterns(dashboard.train()))


def test_the_specification_is_the_json_of_wandb_with_all_names(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("WANDB_API_KEY", raising=False)
    (tmp_path / "run/videos/step-000002").mkdir(parents=True)
    (tmp_path / "run/videos/step-000002/clip7.mp4").write_bytes(b"")
    file = tmp_path / "new/train.json"
    assert dashboard.main(["train", "--to", str(file), "--run", str(tmp_path / "run"), "--project", "tear"]) == 0
    content = json.loads(file.read_text())
    assert capsys.readouterr().out.strip() == str(file)
    assert content["project"] == "tear"
    for key in (*dashboard.keys(dashboard.train()), "video/clip7", dashboard.TRAIN_AXIS):
        assert json.dumps(key) in file.read_text()
    for pattern in dashboard.patterns(dashboard.train()):
        assert json.dumps(pattern) in file.read_text()
    assert dashboard.main(["sweep"]) == 0
    assert json.loads(capsys.readouterr().out)["project"] == "fracsim"


def test_a_run_without_videos_is_refused(tmp_path, capsys):
    assert dashboard.main(["train", "--run", str(tmp_path)]) == 2
    assert "has no videos" in capsys.readouterr().err


def test_a_key_without_a_user_is_refused(monkeypatch, capsys):
    monkeypatch.setenv("WANDB_API_KEY", "0")
    assert dashboard.main(["sweep", "--entity", ""]) == 2
    assert "--entity is missing" in capsys.readouterr().err
