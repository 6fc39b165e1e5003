"""When checkpoints are written: by steps, by minutes, after an epoch, at the end, and when the run is told to stop."""

import signal
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer

from fracgen.training import checkpoint
from fracgen.training.module import Module
from fracsim.entry import Interrupt

EPOCH = 60.0
"""Least age of a checkpoint that the end of an epoch replaces [s]: epochs of a few clips last less."""


AGAIN = 1.0
"""Signals within this time [s] are one: a process group and its leader may both be sent it."""


class Stopped(Exception):  # noqa: N818
    """The run was told to stop, and has written its checkpoint."""


class StopSignal(Interrupt):
    """Signals that ask a run to stop after its forward pass; one more, a second later, stops it at once.

    The signal of batch systems that a job's time is nearly over, SIGUSR1, is one of them.
    """

    _first = 0.0

    def _signals(self) -> list[signal.Signals]:
        """The signals that stop a run."""
        warning: signal.Signals | None = getattr(signal, "SIGUSR1", None)  # Windows has none
        return [*super()._signals(), *([warning] if warning and self._ours else [])]

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.seen:
            if time.monotonic() - self._first > AGAIN:
                raise KeyboardInterrupt
            return
        self.seen, self._first = True, time.monotonic()
        print("stopping: a checkpoint is written first; again to stop at once", file=sys.stderr, flush=True)


class Saver(Callback):
    """Writes the checkpoint of a run when it is time."""

    def __init__(self, path: Path, minutes: float, steps: int, steps_per_epoch: int) -> None:
        self.path, self.seconds, self.steps, self.steps_per_epoch = path, 60 * minutes, steps, steps_per_epoch
        self.signal = StopSignal()
        self._saved = time.monotonic()
        self._at = -1

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """From now on, signals wait for the end of a forward pass."""
        self._saved, self._at = time.monotonic(), trainer.global_step
        self.signal.__enter__()

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Write a checkpoint if it is time; raises Stopped after a signal."""
        assert isinstance(pl_module, Module)
        stepped = len(pl_module.window) == trainer.accumulate_grad_batches
        if not stepped and trainer.world_size > 1:
            return  # all processes decide together, once a step
        step, age = trainer.global_step, time.monotonic() - self._saved
        wanted = self.seconds if step % self.steps_per_epoch else min(self.seconds, EPOCH)
        stop, late = _any(trainer, self.signal.seen, age >= wanted)
        regular = step % self.steps == 0 or step == trainer.max_steps
        if stop or (stepped and (regular or late)):
            self.save(trainer)
        if stop:
            raise Stopped

    def on_validation_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:  # fmt: skip
        """Break a validation off after a signal; the run repeats it when it goes on."""
        if trainer.world_size == 1 and self.signal.seen:
            raise Stopped

    def save(self, trainer: Trainer) -> None:
        """Write the checkpoint, unless this step has one."""
        if self._at != trainer.global_step:
            checkpoint.write(trainer, self.path)
            self._saved, self._at = time.monotonic(), trainer.global_step

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Signals are what they were."""
        self.signal.__exit__(None, None, None)

    def on_exception(self, trainer: Trainer, pl_module: LightningModule, exception: BaseException) -> None:
        """Signals are what they were."""
        if hasattr(self.signal, "_before"):
            self.signal.__exit__(None, None, None)


def _any(trainer: Trainer, *flags: bool) -> list[bool]:
    """Each flag: whether any process has it."""
    if trainer.world_size == 1:
        return list(flags)
    together = torch.tensor([float(flag) for flag in flags], device=trainer.strategy.root_device)
    torch.distributed.all_reduce(together)
    return [value > 0 for value in together.tolist()]
