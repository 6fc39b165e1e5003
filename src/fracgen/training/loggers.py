"""Where curves go: a CSV file in the folder of the run, and beside it wandb or TensorBoard.

wandb is offline unless WANDB_API_KEY or WANDB_MODE say otherwise; `wandb sync FOLDER/wandb/offline-run-*` uploads
later. A run that goes on writes into the same curves.
"""

import csv
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger, TensorBoardLogger, WandbLogger

from fracgen.config.train import TrainConfig
from fracgen.training.ranks import rank
from fracgen.training.runs import METRICS, Run

STEP = "step"


def build(cfg: TrainConfig, run: Run, first: int) -> list[Logger]:
    """The loggers of a run that goes on after `first` optimiser steps; raises ValueError for a missing package."""
    if cfg.logger.kind == "none":
        return []
    out: list[Logger] = [Csv(run.folder / METRICS, first)]
    if cfg.logger.kind == "wandb":
        out.append(_wandb(cfg, run))
    if cfg.logger.kind == "tensorboard":
        out.append(_tensorboard(run))
    return out


def _wandb(cfg: TrainConfig, run: Run) -> Logger:
    """A run of wandb under the name of the folder, whose axis is the number of optimiser steps."""
    mode = os.environ.get("WANDB_MODE") or ("online" if os.environ.get("WANDB_API_KEY") else "offline")
    try:
        logger = WandbLogger(
            name=run.folder.name, id=run.folder.name, resume="allow", save_dir=run.folder, offline=mode == "offline",
            project=cfg.logger.project, group=cfg.logger.group or cfg.name or None, job_type="fracgen.train",
            config=asdict(cfg), mode=mode,
            tags=[f"stage{run.stage}", *([cfg.name] if cfg.name else [])], log_model=False,
        )  # fmt: skip
    except ModuleNotFoundError:
        raise ValueError("logger.kind=wandb needs the package wandb: pip install 'fracsim[watch]', or set "
                         "logger.kind=csv.") from None  # fmt: skip
    if rank() == 0:
        logger.experiment.define_metric("trainer/global_step")
        logger.experiment.define_metric("*", step_metric="trainer/global_step")
    return logger


def _tensorboard(run: Run) -> Logger:
    try:
        return TensorBoardLogger(run.folder, name="", version="tensorboard")
    except ModuleNotFoundError:
        raise ValueError("logger.kind=tensorboard needs the package tensorboardX: pip install tensorboardX, or set "
                         "logger.kind=csv.") from None  # fmt: skip


class Csv(Logger):
    """A table with a row for each optimiser step that was logged; a column more rewrites it."""

    def __init__(self, path: Path, first: int = 0) -> None:
        """Rows after step `first` are dropped: they will be written again."""
        super().__init__()
        self.path = path
        self._rows: dict[int, dict[str, str]] = {}
        self._columns: list[str] = []
        if rank() == 0 and path.is_file():
            self._rows = {step: row for step, row in read(path).items() if step <= first}
            self._columns = list(next(iter(self._rows.values()), {}))
            self._write()

    @property
    def name(self) -> str:
        """Name of the file."""
        return self.path.stem

    @property
    def version(self) -> str:
        """None is needed."""
        return ""

    def log_hyperparams(self, params: Any, *args: Any, **kwargs: Any) -> None:
        """The configuration is a file of its own."""

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Write the values of a step, in the first process; they join those that it has."""
        if rank() > 0:
            return
        row = {STEP: str(step), **{name: f"{value:.9g}" for name, value in metrics.items()}}
        new, known = [name for name in row if name not in self._columns], int(step or 0) in self._rows
        self._rows.setdefault(int(step or 0), {}).update(row)
        self._columns += new
        if new or known or not self.path.is_file():
            self._write()
        else:
            with self.path.open("a", newline="", encoding="utf-8") as file:
                csv.DictWriter(file, self._columns).writerow(row)

    def _write(self) -> None:
        """Write the whole table at once."""
        unfinished = self.path.with_name(f".{self.path.name}.part")
        with unfinished.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, self._columns)
            writer.writeheader()
            writer.writerows(self._rows.values())
        os.replace(unfinished, self.path)


def read(path: Path) -> dict[int, dict[str, str]]:
    """The rows of such a table by step; a row that was not written to its end is left out."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if None not in row.values()]
    return {int(row[STEP]): row for row in rows if row[STEP].isdigit()}
