"""Where the time of a step goes: the last steps of a run under PyTorch's profiler."""

from pathlib import Path
from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer

from fracgen.training.module import Module
from fracgen.training.runs import write

TABLE, TRACE = "profile.txt", "profile.json"
ROWS = 40


class Profile(Callback):
    """Profiles the last `steps` optimiser steps of the first process into the folder of the run."""

    def __init__(self, folder: Path, steps: int) -> None:
        self.folder, self.steps = folder, steps
        self._profiler: Any = None

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Start behind the step that comes before them."""
        assert isinstance(pl_module, Module)
        left = int(trainer.max_steps) - trainer.global_step
        stepped = len(pl_module.window) == trainer.accumulate_grad_batches
        if self._profiler is None and stepped and left <= self.steps and trainer.is_global_zero:
            activities = [torch.profiler.ProfilerActivity.CPU]
            if torch.cuda.is_available():
                activities.append(torch.profiler.ProfilerActivity.CUDA)
            self._profiler = torch.profiler.profile(activities=activities, profile_memory=True)
            self._profiler.start()

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Write table and trace."""
        if self._profiler is None:
            return
        self._profiler.stop()
        key = "self_cuda_time_total" if torch.cuda.is_available() else "self_cpu_time_total"
        write(self.folder / TABLE, self._profiler.key_averages().table(sort_by=key, row_limit=ROWS) + "\n")
        self._profiler.export_chrome_trace(str(self.folder / TRACE))
