"""What is logged: losses by stream and noise level, gradient, learning rate, speed, memory."""

import time
from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer

from fracgen.training.meter import Meter
from fracgen.training.module import PASSES, Losses, Module


class Curves(Callback):
    """Logs means over `every` optimiser steps, and the means of each validation.

    Nothing waits for the device but the means themselves. In checkpoints it keeps its sums, so that a run that goes on
    logs what it would have logged.
    """

    def __init__(self, every: int, steps_per_epoch: int) -> None:
        self.every, self.steps_per_epoch = every, steps_per_epoch
        self.train, self.validation = Meter(), Meter()
        self.shown: dict[str, float] = {}
        """The last means."""
        self.validated = 0
        """Optimiser steps at the last validation."""
        self.clock = Clock()

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Start the clock."""
        self.train.to(pl_module.device)
        self.clock.restart(pl_module.device)

    def on_train_batch_start(self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int) -> None:
        """The data are there."""
        self.clock.arrived()

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Take up the losses of an optimiser step, and log the means when it is time."""
        assert isinstance(pl_module, Module)
        if len(pl_module.window) == trainer.accumulate_grad_batches:
            self._take(pl_module)
            if trainer.global_step % self.every == 0 or trainer.global_step == trainer.max_steps:
                self.shown = self.train.means()
                self.shown |= self._state(trainer, pl_module)
                log(trainer, self.shown)

    def _take(self, module: Module) -> None:
        """Add the losses of an optimiser step."""
        for _, losses in module.window:
            add(self.train, "", module, losses)
            self.train.add_by_level("loss/sigma", losses.flow, losses.sigma)
            self.train.add_histogram("sigma", losses.sigma)
            self.clock.clips += len(losses.flow)
            self.clock.tokens += len(losses.flow) * module.tokens
        assert module.gradient_norm is not None
        self.train.add("grad_norm", module.gradient_norm)

    def _state(self, trainer: Trainer, module: Module) -> dict[str, float]:
        """What is not a mean: learning rates, norms of weights, speed, memory."""
        groups = trainer.optimizers[0].param_groups
        rates = {"lr": groups[0]["lr"]}
        if module.constitutive is not None:
            rates["lr_const"] = groups[-1]["lr"]
            rates["loss/const_weight"] = module.constitutive_weight(trainer.global_step - 1)
            ratio = self.shown["loss/const"] / self.shown["loss/matching"]
            rates["loss/const_share"] = rates["loss/const_weight"] * ratio
        epoch = trainer.global_step / self.steps_per_epoch
        return {**rates, "epoch": epoch, **norms(module), **self.clock.rates(module.device, trainer.world_size)}

    # Validation

    def on_validation_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Begin anew."""
        self.validation = Meter()

    def on_validation_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:  # fmt: skip
        """Add the losses of a batch at all noise levels."""
        assert isinstance(pl_module, Module)
        for losses in outputs[PASSES]:
            add(self.validation, "val/", pl_module, losses)
            self.validation.add_by_level("val/loss/sigma", losses.flow, losses.sigma)
            for k, name in enumerate(pl_module.streams):
                self.validation.add_by_level(f"val/loss/{name}/sigma", losses.streams[:, k], losses.sigma)

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Log the means, and give back the memory that only the validation needed."""
        means = self.validation.means()
        means["val/passes"] = self.validation.last["val/loss/matching"]
        if pl_module.device.type == "cuda":
            torch.cuda.empty_cache()
            means["memory/after_validation_gb"] = torch.cuda.memory_allocated(pl_module.device) / 1e9
        log(trainer, means)
        self.validated = trainer.global_step
        self.clock.pause()

    def state_dict(self) -> dict[str, Any]:
        """What checkpoints hold of it."""
        return {"train": self.train.state(), "validated": self.validated}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """From a checkpoint."""
        self.train.load(state_dict["train"])
        self.validated = state_dict["validated"]


class Clock:
    """Time, clips and tokens since the last log entry, and the time that was spent waiting for data [s]."""

    def __init__(self) -> None:
        self.restart(torch.device("cpu"))

    def restart(self, device: torch.device) -> None:
        """Begin anew."""
        self.clips = self.tokens = 0
        self.start = self.last = time.perf_counter()
        self.waited = 0.0
        if device.type == "cuda":
            torch.cuda.reset_peak_memory_stats(device)

    def arrived(self) -> None:
        """Data are there: what has passed was waiting."""
        self.waited += time.perf_counter() - self.last

    def left(self) -> None:
        """A step is done: what comes is waiting."""
        self.last = time.perf_counter()

    def pause(self) -> None:
        """Leave out the time since the last forward pass."""
        now = time.perf_counter()
        self.start += now - self.last
        self.last = now

    def rates(self, device: torch.device, processes: int) -> dict[str, float]:
        """Speed of all processes, share of waiting and peak memory [GB] of this one; begins anew."""
        seconds = max(time.perf_counter() - self.start, 1e-9)
        out = {"speed/clips_per_s": processes * self.clips / seconds,
               "speed/tokens_per_s": processes * self.tokens / seconds,
               "speed/data_wait": self.waited / seconds, "memory/peak_gb": peak_memory(device) / 1e9}  # fmt: skip
        self.restart(device)
        return out


class Departure(Callback):
    """The last callback of a step: what comes next is waiting for data."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Start to wait."""
        self.clock.left()


def add(meter: Meter, prefix: str, module: Module, losses: Losses) -> None:
    """Add the losses of a batch to a meter."""
    meter.add(f"{prefix}loss/total", losses.total)
    meter.add(f"{prefix}loss/matching", losses.flow)  # of flow matching; loss/flow is that of the stream
    for k, name in enumerate(module.streams):
        meter.add(f"{prefix}loss/{name}", losses.streams[:, k])
    if losses.constitutive is not None:
        meter.add(f"{prefix}loss/const", losses.constitutive.loss)
        meter.add(f"{prefix}gate/mean", losses.constitutive.gate_mean)
        meter.add(f"{prefix}gate/std", losses.constitutive.gate_std)


def peak_memory(device: torch.device) -> int:
    """Largest memory so far [B]: that of tensors on a GPU, of the process on a CPU."""
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device)
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


@torch.no_grad()
def norms(module: Module) -> dict[str, float]:
    """Norms of what is trained: all of it, and lora_B, which is zero as long as an adapter changes nothing."""
    named, maps = list(module.trained()), module.constitutive
    parts = {"norm/trained": [p for _, p in named],
             "norm/lora_B": [p for name, p in named if ".lora_B." in name],
             "norm/const_maps": [] if maps is None else list(maps.parameters())}  # fmt: skip
    return {name: float(torch.nn.utils.get_total_norm(ps)) for name, ps in parts.items() if ps}


def log(trainer: Trainer, values: dict[str, float]) -> None:
    """Write values under the number of optimiser steps to all loggers."""
    for logger in trainer.loggers:
        logger.log_metrics(values, trainer.global_step)
