"""Averaged weights (Polyak and Juditsky 1992) of what is trained; evaluation and the final weights use them.

Lightning's own averages the frozen base, too, and is swapped in before its first update (its issue 21724).
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer
from torch import Tensor

from fracgen.training.module import Module


class Ema(Callback):
    """An exponential average over optimiser steps; its decay grows as (1 + n) / (10 + n) until it is `decay`."""

    def __init__(self, decay: float) -> None:
        self.decay = decay
        self.updates = 0
        self.average: dict[str, Tensor] = {}
        self._kept: dict[str, Tensor] = {}

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Update after an optimiser step."""
        assert isinstance(pl_module, Module)
        if len(pl_module.window) == trainer.accumulate_grad_batches:
            self.update(pl_module)

    @torch.no_grad()
    def update(self, module: Module) -> None:
        """Move the average towards the weights; the first update takes them as they are."""
        weights = {name: p.detach() for name, p in module.trained()}
        if not self.average:
            self.average = {name: w.clone() for name, w in weights.items()}
        else:
            rate = 1 - min(self.decay, (1 + self.updates) / (10 + self.updates))
            torch._foreach_lerp_([self.average[name] for name in weights], list(weights.values()), rate)
        self.updates += 1

    @contextmanager
    def swapped(self, module: Module) -> Iterator[None]:
        """A context in which the module has the averaged weights, if there are any."""
        self.on_validation_start(None, module)
        try:
            yield
        finally:
            self.on_validation_end(None, module)

    @torch.no_grad()
    def on_validation_start(self, trainer: Any, pl_module: LightningModule) -> None:
        """Swap the average in, once it has been updated."""
        assert isinstance(pl_module, Module)
        if self.average and not self._kept:
            for name, p in pl_module.trained():
                self._kept[name] = p.detach().clone()
                p.copy_(self.average[name])

    @torch.no_grad()
    def on_validation_end(self, trainer: Any, pl_module: LightningModule) -> None:
        """Give the weights back."""
        assert isinstance(pl_module, Module)
        for name, p in pl_module.trained():
            if name in self._kept:
                p.copy_(self._kept[name])
        self._kept = {}

    def on_exception(self, trainer: Any, pl_module: LightningModule, exception: BaseException) -> None:
        """Give the weights back when a validation is broken off."""
        self.on_validation_end(trainer, pl_module)

    def state_dict(self) -> dict[str, Any]:
        """What checkpoints hold of it."""
        return {"updates": self.updates, "average": self.average}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """From a checkpoint; the average goes to the device of the weights at its next use."""
        self.updates, self.average = state_dict["updates"], state_dict["average"]

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Bring what a checkpoint has restored to the device."""
        self.average = {name: t.to(pl_module.device) for name, t in self.average.items()}
