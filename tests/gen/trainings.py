"""Trainings that take seconds: a cache of random latents, a transformer of one block, and what its curves say."""

import csv
from pathlib import Path
from typing import Any

from fracgen.config.train import TrainConfig
from fracgen.data import synthetic
from fracgen.train import TRAIN
from fracgen.training.runs import METRICS

SMALL = ("model=tiny", "model.layers=1", "model.heads=2", "model.head_dim=16", "model.ffn_dim=32", "model.text_dim=8",
         "trainer=cpu", "trainer.batch=1", "trainer.effective_batch=4", "data.workers=0",
         "logger.videos=0", "measure.clips=0",
         "stages=toy", "stages.stage1.steps=6", "stages.stage2.steps=4", "stages.stage3.steps=4",
         "stages.stage1.warmup=2", "stages.stage2.warmup=2", "stages.stage3.warmup=2",
         "trainer.log_steps=1", "trainer.val_steps=2", "trainer.val_levels=2", "data.val_limit=3")  # fmt: skip
"""Six steps of a network of 20 thousand weights; an epoch is two steps of four forward passes."""
TIMED = ("speed/", "memory/")
"""Beginnings of the columns that depend on the machine and the time."""


def cache(folder: Path, **options: Any) -> Path:
    """A latent cache of 16 clips of 5 frames, 16 x 16 pixels; 8 are to train on."""
    return synthetic.write(folder, **{"clips": 16, "frames": 5, "size": 16, "text_dim": 8, **options})


def overrides(folder: Path, latents: Path, *more: str) -> list[str]:
    """The command line of a small training into `folder`."""
    return [*SMALL, f"data.folder={latents}", f"output.folder={folder}", *more]


def config(folder: Path, latents: Path, *more: str) -> TrainConfig:
    """The configuration of a small training into `folder`."""
    return TRAIN.compose(*overrides(folder, latents, *more))


def curves(run: Path) -> dict[int, dict[str, float]]:
    """What the curves of a run say at each step, but for time and memory."""
    with (run / METRICS).open(newline="") as file:
        return {int(row["step"]): {name: float(v) for name, v in row.items() if v and not name.startswith(TIMED)}
                for row in csv.DictReader(file)}  # fmt: skip


def only(folder: Path, stage: int = 1) -> Path:
    """The only run of a stage in a folder of runs."""
    (found,) = folder.glob(f"stage{stage}-*")
    return found
