"""Checkpoints: what was trained, the state of the optimiser, and what they belong to; written at once, read safely.

A checkpoint is taken after an optimiser step, and training goes on with the next one: nothing else is restored, since
order, noise and learning rate are functions of the step.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer
from torch import Tensor

from fracgen.training.identity import differences
from fracgen.training.module import Module
from fracgen.training.runs import Run

ENTRY = "fracgen"
"""Entry of a checkpoint with its step and what shapes the weights of its run."""


def write(trainer: Trainer, path: Path) -> None:
    """Write a checkpoint; all processes call this together. Whoever is killed in it leaves the last one whole."""
    unfinished = path.with_name(f".{path.name}.part")
    trainer.save_checkpoint(unfinished)
    if trainer.is_global_zero:
        os.replace(unfinished, path)
    trainer.strategy.barrier("checkpoint")


def read(run: Run) -> dict[str, Any] | None:
    """The checkpoint of a run, or None; raises ValueError for a damaged one, or one of other weights than this run."""
    if not run.checkpoint.is_file():
        return None
    try:
        content: dict[str, Any] = torch.load(run.checkpoint, map_location="cpu", weights_only=True)
        there: Mapping[str, Any] = content[ENTRY]
    except Exception as error:  # what unpickling raises is not ours to list
        raise ValueError(f"{run.checkpoint} cannot be read ({type(error).__name__}: {error}): remove it, or repeat the "
                         "run with output.overwrite=true.") from None  # fmt: skip
    faults = list(differences(run.content, there["identity"]))
    if faults:
        raise ValueError(f"{run.checkpoint} belongs to another training: {'; '.join(faults)}. Remove it, or repeat the "
                         "run with output.overwrite=true.")  # fmt: skip
    return content


def step_of(content: Mapping[str, Any] | None) -> int:
    """Optimiser steps that are done in a checkpoint; 0 without one."""
    return int(content[ENTRY]["step"]) if content else 0


class Restore(Callback):
    """Puts a checkpoint into module, optimiser and callbacks, and says what checkpoints hold."""

    def __init__(self, run: Run, content: dict[str, Any] | None) -> None:
        self.run = run
        self.step = step_of(content)
        self._content = content

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Restore, once optimiser and device are there."""
        content, self._content = self._content, None
        if content is None:
            return
        assert isinstance(pl_module, Module)
        load(pl_module, content["state_dict"])
        trainer.optimizers[0].load_state_dict(content["optimizer_states"][0])
        for callback in trainer.callbacks:  # type: ignore[attr-defined]
            if callback.state_key in content["callbacks"]:
                callback.load_state_dict(content["callbacks"][callback.state_key])
        loop = trainer.fit_loop.epoch_loop
        loop.automatic_optimization.optim_progress.optimizer.step.total.completed = self.step
        loop.batch_progress.total.ready = self.step * trainer.accumulate_grad_batches
        loop._batches_that_stepped = self.step

    def on_save_checkpoint(self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]) -> None:
        """Keep what was trained only, and name what it belongs to."""
        assert isinstance(pl_module, Module)
        checkpoint["state_dict"] = {name: p.detach() for name, p in pl_module.trained()}
        checkpoint[ENTRY] = {"step": trainer.global_step, "identity": self.run.content}


def load(module: Module, tensors: Mapping[str, Tensor]) -> None:
    """Put trained tensors into a module; raises ValueError naming tensors that are missing, too many or misshapen."""
    own = dict(module.trained())
    wrong = [n for n in {**own, **tensors} if n not in own or n not in tensors or own[n].shape != tensors[n].shape]
    if wrong:
        raise ValueError(f"the checkpoint does not fit the model: {', '.join(wrong[:5])} are missing, too many or of "
                         "another shape; repeat the run with output.overwrite=true.")  # fmt: skip
    with torch.no_grad():
        for name, parameter in own.items():
            parameter.copy_(tensors[name])
