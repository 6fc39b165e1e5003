"""Clips from a cache against encoding them, waiting for data, and Lightning's trainer against a plain loop.

The trainer is `fracgen.training.stages`, as the command runs it, with its callbacks and its CSV file. The plain loop
runs the same module on the same batches. Both are run in turn in one process, and each speed is that of the second half
of a run.
"""

import contextlib
import csv
import io
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import torch

from fracgen import data, vae
from fracgen.bench import cases
from fracgen.bench.record import Row, median
from fracgen.bench.step import seconds
from fracgen.config.train import Data, Logger, Measure, Recipe, Runs, Stages, TrainConfig
from fracgen.data import synthetic
from fracgen.layout import STREAMS
from fracgen.memory.size import Size
from fracgen.training import schedule, stages
from fracgen.training.module import Module
from fracgen.training.runs import METRICS
from fracgen.training.stream import StageData

OVERHEAD, WAIT = 3.0, 5.0
"""What the trainer may add to a plain loop, and what waiting for data may take of a step [%]."""
CLIPS = 16


def rows(quick: bool = False) -> Iterator[Row]:
    """All figures; `quick` takes the smallest sizes, without targets."""
    name, size = ("tiny", Size(32, 32, 5, 5)) if quick else ("mid", cases.SIZES["mid"])
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        model = cases.MODELS[name]
        latents = synthetic.write(
            root / "latents", 2 * CLIPS, frames=size.frames, size=size.width, text_dim=model.text_dim,
            image_dim=model.image_dim,
        )  # fmt: skip
        yield from reading(latents, size, 1 if quick else 5)
        yield from trainers(root, latents, name, size, quick)


def reading(latents: Path, size: Size, repeats: int) -> Iterator[Row]:
    """A clip with all its streams from the cache, and its six videos through the small VAE."""
    cache, encoder = data.open(latents), vae.load(cases.small_vae())
    video = torch.rand(1, 3, size.frames, size.height, size.width)
    read = seconds(lambda: [cache[k] for k in range(CLIPS)], repeats)
    live = seconds(lambda: [encoder.encode(video) for _ in (*STREAMS, "force")], repeats)
    label = f"{size.width} x {size.height} px, {size.frames} frames, {len(STREAMS)} streams and the force"
    yield median("a clip from the cache", label, [1e3 * t / CLIPS for t in read], "ms")
    yield median("a clip encoded live", f"{label}, vae=tiny", [1e3 * t for t in live], "ms")


def trainers(root: Path, latents: Path, name: str, size: Size, quick: bool) -> Iterator[Row]:
    """Tokens a second of both loops, what the trainer adds, and its share of waiting."""
    steps, pairs = (4, 1) if quick else (16, 5)
    cfg = config(latents, name, steps)
    ours, plain, waits = [], [], []
    for k in range(pairs):
        speed, wait = by_trainer(replace(cfg, output=Runs(folder=str(root / f"runs{k}"))))
        ours.append(speed)
        waits.append(100 * wait)
        plain.append(by_loop(cfg, size))
    label = f"{name}, {size.tokens} tokens, {steps} optimiser steps of 2 clips"
    yield median("tokens by the trainer", label, ours, "1/s")
    yield median("tokens by a plain loop", label, plain, "1/s")
    added = [100 * (p / o - 1) for o, p in zip(ours, plain, strict=True)]
    yield median("time that the trainer adds", label, added, "%", None if quick else OVERHEAD)
    yield median("waiting for data, share of a step", label, waits, "%", None if quick else WAIT)


def config(latents: Path, name: str, steps: int) -> TrainConfig:
    """A training of `steps` optimiser steps on all streams, without validation."""
    base = cases.config(cases.MODELS[name])
    trainer = replace(base.trainer, val_steps=0, log_steps=steps // 2, save_steps=10 * steps)
    recipe = Recipe(streams=list(STREAMS), constitutive=True, steps=steps, warmup=2)
    return replace(
        base, stage=1, trainer=trainer, data=Data(folder=str(latents), workers=1), logger=Logger(videos=0),
        measure=Measure(clips=0),
        stages=Stages(stage1=recipe),
    )  # fmt: skip


def by_trainer(cfg: TrainConfig) -> tuple[float, float]:
    """Tokens a second, and the share of time spent waiting for data, in the second half of a training."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        (run,) = stages.run(cfg)
    with (run.folder / METRICS).open(newline="", encoding="utf-8") as file:
        last = list(csv.DictReader(file))[-1]
    return float(last["speed/tokens_per_s"]), float(last["speed/data_wait"])


def by_loop(cfg: TrainConfig, size: Size) -> float:
    """Tokens a second in the second half of a plain loop over the same module and the same batches."""
    device = "cuda" if torch.cuda.is_available() else "cpu"
    clips = StageData(cfg, STREAMS)
    clips.first, clips.total = 0, cfg.stages.stage1.steps
    module = cases.module(cfg, size, device)
    optimiser = module.configure_optimizers()
    assert isinstance(optimiser, torch.optim.Optimizer)
    half, begin, done = clips.total // 2 * cfg.trainer.effective_batch, 0.0, 0
    for batch in clips.train_dataloader():
        if done == half:
            begin = time.perf_counter()
        cases.forward_backward(module, module.transfer_batch_to_device(batch, torch.device(device), 0))
        done += len(batch.ids)
        if done % cfg.trainer.effective_batch == 0:
            _optimise(module, optimiser, done // cfg.trainer.effective_batch)
    return (done - half) * size.tokens / (time.perf_counter() - begin)


def _optimise(module: Module, optimiser: torch.optim.Optimizer, step: int) -> None:
    """Limit the gradient, set the learning rate, change the weights."""
    torch.nn.utils.clip_grad_norm_([p for _, p in module.trained()], module.cfg.trainer.clip)
    factor = schedule.learning_rate(step, module.recipe.warmup, module.total)
    for group in optimiser.param_groups:
        group["lr"] = group["full_lr"] * factor
    optimiser.step()
    optimiser.zero_grad(set_to_none=True)
