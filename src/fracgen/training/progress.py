"""What a run shows while it trains: a bar with rate and time left on a terminal, else a line for each log entry."""

import sys
import time
from typing import Any

from lightning import Callback, LightningModule, Trainer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from fracgen.training.curves import Curves
from fracgen.training.module import Module


class Bar(Callback):
    """Shows how far a run is."""

    def __init__(self, name: str, curves: Curves) -> None:
        self.name, self.curves = name, curves
        self._console = Console(stderr=True)
        self._progress: Progress | None = None
        self._task: Any = None
        self._start = (0, 0.0)

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Show it in the first process."""
        self._start = trainer.global_step, time.monotonic()
        if not trainer.is_global_zero or not self._console.is_terminal:
            return
        self._progress = Progress(
            TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
            TimeRemainingColumn(), TextColumn("{task.fields[state]}"), console=self._console,
        )  # fmt: skip
        total = int(trainer.max_steps)
        self._task = self._progress.add_task(self.name, total=total, completed=trainer.global_step, state="")
        self._progress.start()

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Move on after an optimiser step."""
        assert isinstance(pl_module, Module)
        if len(pl_module.window) != trainer.accumulate_grad_batches or not trainer.is_global_zero:
            return
        step, shown = trainer.global_step, self.curves.shown
        state = f"loss {shown['loss/total']:.4g}  {shown['speed/clips_per_s']:.3g} clips/s" if shown else ""
        if self._progress is not None:
            self._progress.update(self._task, completed=step, state=state)
        elif step % self.curves.every == 0 or step == trainer.max_steps:
            print(f"{self.name}  step {step}/{trainer.max_steps}  {state}  {self._left(trainer)}", file=sys.stderr)

    def _left(self, trainer: Trainer) -> str:
        """Time left, for people."""
        first, start = self._start
        done, rest = trainer.global_step - first, int(trainer.max_steps) - trainer.global_step
        seconds = round((time.monotonic() - start) * rest / max(done, 1))
        return f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02} left"

    def on_validation_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Say that it validates."""
        if self._progress is not None:
            self._progress.update(self._task, state="validating")

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Leave the bar as it is."""
        if self._progress is not None:
            self._progress.stop()

    def on_exception(self, trainer: Trainer, pl_module: LightningModule, exception: BaseException) -> None:
        """Leave the bar as it is."""
        self.on_train_end(trainer, pl_module)
