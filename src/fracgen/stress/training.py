"""Cases of a training: learning rates, broken caches, few clips, short clips."""

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from fracgen.layout import DAMAGE
from fracgen.model import trained
from fracgen.stress.case import Case
from fracgen.stress.place import latents, train
from fracgen.training.runs import METRICS
from fracsim.records import Array

UNREAL = r"(the loss|the gradient) is not finite in optimiser step \d+"


def cases() -> list[Case]:
    """All of them."""
    return [
        Case("learning rate 1", lambda p, f: trains(p.latents, f, "stages.stage1.lr=1", "stages.stage1.steps=8"),
             refusal=UNREAL, either=True),
        Case("learning rate 1, bfloat16, no limit of the gradient",
             lambda p, f: trains(p.latents, f, "stages.stage1.lr=1", "stages.stage1.steps=8", "trainer.clip=0",
                                 "trainer.precision=bf16-mixed"), refusal=UNREAL, either=True, slow=True),
        Case("NaN in one latent of a cache", lambda p, f: trains(spoilt(f), f, "stages.stage1.steps=8"),
             refusal=f"{UNREAL}.*clip0000"),
        Case("a cache with one clip", lambda p, f: trains(latents(f / "one", clips=1), f, "trainer.effective_batch=1")),
        Case("a cache with one clip, a batch of two", lambda p, f: trains(latents(f / "one", clips=1), f),
             refusal=r"trainer\.effective_batch", slow=True),
        Case("a cache without clips", lambda p, f: trains(latents(f / "none", clips=0), f), refusal=r"data\.",
             slow=True),
        Case("clips of one frame", lambda p, f: trains(latents(f / "one", frames=1), f), slow=True),
        Case("clips of 16 x 16 pixels", lambda p, f: trains(latents(f / "small", size=16), f), slow=True),
        Case("captions and pictures all left out",
             lambda p, f: trains(p.latents, f, "conditioning.drop_text=1", "conditioning.drop_reference=1"), slow=True),
        Case("weight of the constitutive loss 1e6",
             lambda p, f: trains(p.latents, f, "loss.lambda_const=1e6", "loss.ramp=0", "loss.lame=E",
                                 "stages.stage1.steps=8"), refusal=UNREAL, either=True, slow=True),
    ]  # fmt: skip


def trains(cache: Path, folder: Path, *overrides: str) -> Iterator[Array | Tensor]:
    """What was trained, and all that the curves say."""
    (run,) = train(folder, cache, "logger.kind=csv", "logger.videos=0", "trainer.log_steps=1", *overrides)
    tensors, _ = trained.read(run.folder)
    yield from tensors.values()
    with (run.folder / METRICS).open(newline="", encoding="utf-8") as file:
        yield from (np.array([float(v) for v in row.values() if v]) for row in csv.DictReader(file))


def spoilt(folder: Path) -> Path:
    """A cache in whose first clip one number of a latent is NaN; the file is as long as before."""
    cache = latents(folder / "spoilt", clips=8)
    for file in cache.glob("shard-*.safetensors"):
        with safe_open(file, framework="pt") as content:
            tensors, about = {name: content.get_tensor(name) for name in list(content.keys())}, content.metadata()
        for name, tensor in tensors.items():
            if name.startswith("clip0000.") and name.endswith(DAMAGE):
                tensor.view(-1)[7] = torch.nan
        save_file(tensors, file, about)
    return cache
