"""Numbers that are not finite: the step is not taken, and what made them is kept in a file that can be computed again.

`python -m fracgen.train replay=FILE` computes it again and names the first layer whose output is not finite.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save_file
from torch import Tensor

from fracgen.data.batch import Batch
from fracgen.layout import STREAMS
from fracgen.training.module import Losses, Module
from fracgen.training.ranks import rank

BATCH, WEIGHTS = "batch.", "weights."
"""What names of tensors in a file begin with."""


class Guard:
    """Called before each optimiser step: one look at the losses and the gradient, one wait for the device."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(self, module: Module) -> None:
        """Raise ValueError, after saving what is needed to compute it again, when a loss or the gradient is not
        finite."""
        assert module.gradient_norm is not None
        totals = torch.stack([losses.total for _, losses in module.window])
        if bool(torch.isfinite(totals.sum() + module.gradient_norm)):
            return
        batches = [b for b, _ in broken(module.window)]
        file = save(self.folder, module, batches)
        what = "the loss" if not torch.isfinite(totals).all() else "the gradient"
        raise ValueError(f"{what} is not finite in optimiser step {module.global_step}, with clips "
                         f"{', '.join(name for b in batches for name in b.ids)}; the step was not taken. "
                         f"`python -m fracgen.train replay={file}` computes it again and names the layer where it "
                         "begins; a smaller learning rate (stages), trainer.clip or trainer.precision=32-true may "
                         "help; the same command goes on from the last checkpoint.")  # fmt: skip


def broken(window: Sequence[tuple[Batch, Losses]]) -> list[tuple[Batch, Losses]]:
    """The forward passes whose loss is not finite; all of them when it is the gradient's fault."""
    return [(b, losses) for b, losses in window if not bool(torch.isfinite(losses.total))] or list(window)


def save(folder: Path, module: Module, batches: Sequence[Batch]) -> Path:
    """Write batches, trained weights and configuration to a file in the folder of the run, and return it."""
    file = folder / f"nan-{module.global_step}{f'-rank{rank()}' if rank() else ''}.safetensors"
    together = concatenated(batches)
    tensors = {f"{BATCH}{name}": t for name, t in flat(together).items()}
    tensors.update({f"{WEIGHTS}{name}": p.detach() for name, p in module.trained()})
    about = {"ids": together.ids, "step": module.global_step, "recipe": asdict(module.recipe),
             "config": asdict(module.cfg)}  # fmt: skip
    save_file({name: t.cpu().contiguous() for name, t in tensors.items()}, file, {"about": json.dumps(about)})
    return file


def flat(batch: Batch) -> dict[str, Tensor]:
    """The tensors of a batch, [B, ...] each, by name; a stream by `latents.NAME`."""
    single = {name: t for name, t in batch._asdict().items() if isinstance(t, Tensor)}
    return {**single, **{f"latents.{name}": t for name, t in batch.latents.items()}}


def unflat(ids: Sequence[str], tensors: dict[str, Tensor]) -> Batch:
    """The batch of what `flat` has made, [B, ...] each."""
    streams = {f"latents.{name}": name for name in STREAMS if f"latents.{name}" in tensors}
    others: dict[str, Any] = {name: t for name, t in tensors.items() if name not in streams}
    latents = {name: tensors[key] for key, name in streams.items()}
    return Batch(ids=list(ids), latents=latents, image=others.pop("image", None), **others)


def concatenated(batches: Sequence[Batch]) -> Batch:
    """Batches, [B, ...] each, as one."""
    parts = [flat(batch) for batch in batches]
    together = {name: torch.cat([part[name] for part in parts]) for name in parts[0]}
    return unflat([one for batch in batches for one in batch.ids], together)
