"""What happens at the ends of a run: a validation that is due, the file of trained weights, the mark of a finished run.

They happen inside Lightning's fit, where all processes are together.
"""

import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from lightning import Callback, LightningModule, Trainer
from torch import Tensor

from fracgen.conditioning import SCALARS
from fracgen.model import trained
from fracgen.training import plots
from fracgen.training.curves import Curves
from fracgen.training.ema import Ema
from fracgen.training.module import Module
from fracgen.training.runs import TRAINED, Run
from fracgen.training.stream import StageData


class Ending(Callback):
    """Validates when a run goes on behind one that was broken off, and at its end; then writes what was trained."""

    def __init__(self, run: Run, curves: Curves, ema: Ema | None, parent: str, cache: Mapping[str, Any]) -> None:
        """`parent` is the folder of the run whose weights this one started from, or empty; `cache` says how its latents
        were made."""
        self.run, self.curves, self.ema, self.parent, self.cache = run, curves, ema, parent, dict(cache)
        self._start = time.monotonic()

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Repeat a validation that was broken off after the checkpoint."""
        assert isinstance(pl_module, Module)
        every = pl_module.cfg.trainer.val_steps
        if trainer.global_step and every and trainer.global_step % every == 0:
            self._validate(trainer)

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Validate what the run ends with, and finish it."""
        assert isinstance(pl_module, Module)
        if pl_module.cfg.trainer.val_steps:
            self._validate(trainer)
        self.finish(trainer, pl_module)

    def late(self, trainer: Trainer, module: Module, data: StageData) -> None:
        """Do the same for a run that was stopped behind its last step, which Lightning does not begin."""
        if self.curves.validated != trainer.global_step and module.cfg.trainer.val_steps and data.val_clips:
            trainer.validate(module, datamodule=data, verbose=False)
        self.finish(trainer, module)

    def finish(self, trainer: Trainer, pl_module: Module) -> None:
        """Write the trained weights, and mark the run as finished; all processes call this together."""
        if trainer.is_global_zero:
            trained.save(self.run.folder / TRAINED, self._weights(pl_module), self._about(pl_module))
            facts = {"stage": self.run.stage, "id": self.run.id, "steps": trainer.global_step, "parent": self.parent,
                     "seconds": round(time.monotonic() - self._start, 1), **self.curves.shown}  # fmt: skip
            plots.losses(self.run.folder)
            self.run.finish(facts)
        trainer.strategy.barrier("finished")

    def _validate(self, trainer: Trainer) -> None:
        """Validate, unless this step has been; as Lightning does in the middle of an epoch."""
        if self.curves.validated == trainer.global_step or not trainer.enable_validation:
            return
        trainer.validating = True
        trainer.fit_loop.epoch_loop.val_loop.run()
        trainer.training = True

    def _weights(self, module: Module) -> dict[str, Tensor]:
        """The trained tensors, averaged where that was asked for."""
        if self.ema is not None and self.ema.average:
            return dict(self.ema.average)
        return {name: p.detach() for name, p in module.trained()}

    def _about(self, module: Module) -> dict[str, Any]:
        """What the file says about itself."""
        cfg = module.cfg
        return {
            "stage": self.run.stage, "streams": list(module.streams), "model": asdict(cfg.model),
            "base": self.run.content["base"], "scalars": list(SCALARS), "conditioning": asdict(cfg.conditioning),
            "config": asdict(cfg), "cache": self.cache, "id": self.run.id, "identity": self.run.content,
        }  # fmt: skip
