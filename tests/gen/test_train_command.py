"""`python -m fracgen.train`: every configuration composes and runs, errors are told once, loggers and videos."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from omegaconf import OmegaConf

from fracgen import vae
from fracgen.config.model import Vae
from fracgen.train import TRAIN
from fracgen.training import mosaic, stages
from fracgen.training.loggers import Csv, read
from tests.command import environment
from tests.gen.trainings import SMALL, cache, config, curves, only, overrides

CONF = TRAIN.folder
EXPERIMENTS = tuple(sorted(p.stem for p in (CONF / "experiment").glob("*.yaml")))
DEBUG = tuple(sorted(p.stem for p in (CONF / "debug").glob("*.yaml")))
FILES = sorted(p for group in ("data", "stages", "trainer", "logger") for p in (CONF / group).glob("*.yaml"))
TINY = tuple(o for o in SMALL if o.startswith(("model", "trainer.batch")))
"""Whatever the experiment, in its stead the small network, on a CPU."""


def command(*arguments: str) -> "subprocess.CompletedProcess[str]":
    """`python -m fracgen.train ARGUMENTS`, run to its end."""
    return subprocess.run([sys.executable, "-m", "fracgen.train", *arguments], env=environment(OMP_NUM_THREADS="1"),
                          capture_output=True, text=True, timeout=240)  # fmt: skip


@pytest.fixture(scope="module")
def latents(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache that says it was made by the random tiny VAE."""
    folder = cache(tmp_path_factory.mktemp("latents"))
    about = json.loads((folder / "cache.json").read_text())
    identity = vae.load(TRAIN.compose("vae=tiny").vae).identity
    (folder / "cache.json").write_text(json.dumps({**about, "vae": identity}))
    return folder


# Configurations


@pytest.mark.parametrize("file", FILES, ids=lambda p: f"{p.parent.name}={p.stem}")
def test_every_file_of_a_group_composes_and_sets_what_it_says(file: Path) -> None:
    group = file.parent.name
    composed = OmegaConf.to_container(OmegaConf.structured(getattr(TRAIN.compose(f"{group}={file.stem}"), group)))
    content: Any = OmegaConf.to_container(OmegaConf.load(file))
    assert OmegaConf.to_container(OmegaConf.merge(composed, content)) == composed


@pytest.mark.parametrize("debug", DEBUG)
@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_experiment_composes_alone_and_with_every_debug_choice(experiment: str, debug: str) -> None:
    assert TRAIN.compose(f"+experiment={experiment}").name == experiment
    assert TRAIN.compose(f"+experiment={experiment}", f"+debug={debug}").name == debug


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_experiment_runs(experiment: str, latents: Path, tmp_path: Path) -> None:
    """Its three stages, two steps each, with the small network."""
    choices = [f"+experiment={experiment}", "+debug=fast", "model=tiny", *TINY[1:], "trainer=cpu"]
    cfg = TRAIN.compose(*choices, "trainer.effective_batch=2", f"data.folder={latents}", f"output.folder={tmp_path}",
                        "stage=all", "data.workers=0", "logger.videos=0")  # fmt: skip
    assert [run.finished for run in stages.run(cfg)] == [True, True, True]


@pytest.mark.parametrize("debug", DEBUG)
def test_every_debug_choice_runs(debug: str, latents: Path, tmp_path: Path) -> None:
    more = ("trainer=cpu", "trainer.batch=1", "trainer.effective_batch=1", "data.workers=0", "logger.videos=0")
    steps = () if debug == "profile" else tuple(f"stages.stage{k}.steps=2" for k in (1, 2, 3))
    (run,) = stages.run(TRAIN.compose(f"+debug={debug}", "model=tiny", *TINY[1:], *more, *steps,
                                      f"data.folder={latents}", f"output.folder={tmp_path}"))  # fmt: skip
    assert run.finished
    if debug == "profile":
        assert "aten::addmm" in (run.folder / "profile.txt").read_text()
        assert (run.folder / "profile.json").stat().st_size > 1000


def test_the_default_is_the_published_recipe() -> None:
    cfg = TRAIN.compose()
    assert (cfg.model.layers, cfg.model.train, cfg.model.lora.rank, cfg.model.lora.alpha) == (30, "lora", 64, 64)
    assert (cfg.trainer.effective_batch, cfg.loss.shift, cfg.loss.lambda_const) == (16, 5.0, 0.1)
    recipes = (cfg.stages.stage1, cfg.stages.stage2, cfg.stages.stage3)
    assert [(len(r.streams), r.constitutive, r.epochs, r.warmup) for r in recipes] == [
        (1, False, 3, 40), (5, False, 3, 40), (5, True, 2, 40)]  # fmt: skip


# The command


def test_help_lists_groups_and_fields() -> None:
    done = command("--help")
    assert done.returncode == 0
    for text in ("stage=1", "loss.lambda_const=0.1", "+experiment", "paper_512", "overfit", "trainer.ema",
                 "model.lora: Low-rank adapters", "model.lora.rank=64", "stages.stage3.constitutive=true"):  # fmt: skip
        assert text in done.stdout


def test_without_weights_one_error_says_what_is_missing_and_what_runs_without(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    done = command("stage=3", f"output.folder={tmp_path / 'runs'}")
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("error: model.path is missing")
    assert "model=tiny" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "runs").exists()


def test_a_multirun_of_stage_three_goes_on_behind_an_error_and_prints_the_folders(
    latents: Path, tmp_path: Path
) -> None:
    """Two weights of the constitutive loss, and one that is not allowed between them."""
    short = [f"stages.stage{k}.steps=1" for k in (1, 2, 3)]
    stages.run(config(tmp_path, latents, *short, "stage=all", "trainer.val_steps=0"))
    done = command(
        "-m", *overrides(tmp_path, latents, *short), "stage=3", "loss.lambda_const=0,-1,0.3", "trainer.val_steps=0"
    )
    assert done.returncode == 2
    assert done.stderr.count("error: loss.lambda_const=-1 is not allowed") == 1
    runs = {str(p) for p in tmp_path.glob("stage3-*")}
    assert len(runs) == 3
    assert sum(f"finished: {run}" in done.stdout for run in runs) == 2
    assert len(list(tmp_path.glob("stage2-*"))) == 1


def test_a_cache_without_a_map_is_refused_by_name(tmp_path: Path) -> None:
    few = cache(tmp_path / "few", streams=("rgb", "flow"))
    with pytest.raises(ValueError, match="lacks strain, stress, damage"):
        stages.run(config(tmp_path, few, "stage=2", "init_from=none"))


# Loggers


def test_a_table_gains_columns_joins_rows_and_goes_on_from_a_step(tmp_path: Path) -> None:
    file = tmp_path / "metrics.csv"
    table = Csv(file)
    table.log_metrics({"a": 1.0}, 1)
    table.log_metrics({"a": 2.0, "b": 0.1}, 2)
    table.log_metrics({"c": 5.0}, 2)
    table.log_metrics({"a": 3.0}, 3)
    with file.open("a") as torn:
        torn.write("4,1.")
    assert read(file)[2] == {"step": "2", "a": "2", "b": "0.1", "c": "5"}
    again = Csv(file, first=2)
    again.log_metrics({"a": 30.0}, 3)
    assert {step: row["a"] for step, row in read(file).items()} == {1: "1", 2: "2", 3: "30"}


def test_nothing_is_logged_without_a_logger(latents: Path, tmp_path: Path) -> None:
    (run,) = stages.run(config(tmp_path, latents, "logger.kind=none", "stages.stage1.steps=1"))
    assert not (run.folder / "metrics.csv").exists()


def test_wandb_is_offline_without_a_key(latents: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wandb = pytest.importorskip("wandb")
    for name in ("WANDB_API_KEY", "WANDB_MODE"):
        monkeypatch.delenv(name, raising=False)
    more = (
        "logger.kind=wandb",
        "vae=tiny",
        "logger.videos=1",
        "logger.video_steps=1",
        "stages.stage1.steps=1",
        "name=study",
    )
    (run,) = stages.run(config(tmp_path, latents, *more))
    wandb.finish()
    (offline,) = (run.folder / "wandb").glob("offline-run-*")
    assert list(offline.glob("*.wandb"))
    assert list(offline.rglob("*.mp4")), "the video was given by its path"
    assert curves(run.folder)[1]["loss/rgb"] > 0


# Videos


def test_videos_show_force_prediction_and_truth(latents: Path, tmp_path: Path) -> None:
    """A row of three tiles of 16 x 16 pixels in stage 1; three rows of up to four with maps."""
    from fracsim.sample import video

    more = ("vae=tiny", "logger.videos=2", "logger.video_steps=1", "init_from=none", "stages.stage1.steps=1")
    for stage, size in ((1, (48, 16)), (3, (64, 48))):
        stages.run(config(tmp_path, latents, *more, f"stage={stage}", f"stages.stage{stage}.steps=1"))
        files = sorted((only(tmp_path, stage) / "videos" / "step-000001").glob("*.mp4"))
        assert [f.stem for f in files] == ["clip0002", "clip0003"]
        assert video.count(files[0]) == 5
        assert {"video/luminance_jump", "video/luminance_jump_true"} <= set(curves(only(tmp_path, stage))[1])
        assert mosaic_size(files[0]) == size


def mosaic_size(file: Path) -> tuple[int, int]:
    import imageio.v3 as iio

    height, width, _ = iio.imread(file, index=0).shape
    return width, height


def test_a_jump_of_luminance_between_the_first_frames_is_measured() -> None:
    """From black to white it is 1, in blue only 0.0722."""
    import numpy as np

    video = np.zeros((3, 4, 4, 3), dtype=np.uint8)
    video[1:] = 255
    assert mosaic.luminance_jump(video) == pytest.approx(1.0)
    video[1:, ..., :2] = 0
    assert mosaic.luminance_jump(video) == pytest.approx(0.0722)
    assert mosaic.luminance_jump(video[:1]) == 0


def test_another_vae_than_that_of_the_cache_is_refused_and_none_is_said(
    latents: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ValueError, match=r"the latents in data.folder=.* were made by \w+: give that VAE"):
        stages.run(config(tmp_path, latents, "vae=tiny", "vae.seed=1", "logger.videos=1"))
    stages.run(config(tmp_path, latents, "logger.videos=1", "stages.stage1.steps=1"))
    assert capsys.readouterr().err.count("no videos of the validation: vae.path is not set") == 1


def test_a_vae_configuration_is_part_of_a_training() -> None:
    assert isinstance(TRAIN.compose("vae=tiny").vae, Vae)
