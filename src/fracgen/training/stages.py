"""The stages of a training: each starts from the weights of the one before, or goes on where it was stopped."""

import logging
import sys
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from lightning import Callback, Trainer
from lightning.pytorch.strategies import DDPStrategy

from fracgen import model
from fracgen.config.train import TrainConfig
from fracgen.config.train import Trainer as TrainerConfig
from fracgen.memory import planner
from fracgen.model import trained
from fracgen.training import checkpoint, identity, loggers, network, panel, runs, schedule
from fracgen.training.checkpoint import Restore
from fracgen.training.curves import Curves, Departure
from fracgen.training.ema import Ema
from fracgen.training.ending import Ending
from fracgen.training.guard import Guard
from fracgen.training.module import Module
from fracgen.training.profile import Profile
from fracgen.training.progress import Bar
from fracgen.training.ranks import rank
from fracgen.training.runs import Run
from fracgen.training.saving import Saver
from fracgen.training.stream import StageData

STAGES = (1, 2, 3)


def run(cfg: TrainConfig) -> list[Run]:
    """Train the stages that are asked for, one after the other, and return their runs; a finished one is not repeated.

    Raises ValueError, before training begins, for what cannot be trained; raises saving.Stopped after a signal.
    """
    if cfg.stage != "all":
        return [train(cfg, int(cfg.stage))]
    done = [train(cfg, 1)]
    for stage in STAGES[1:]:
        done.append(train(cfg, stage, done[-1].folder))
    return done


def train(cfg: TrainConfig, stage: int, parent: Path | None = None) -> Run:
    """Train a stage from the weights of the run in `parent`, or as `cfg.init_from` says, and return its run."""
    recipe = identity.recipe_of(cfg, stage)
    data = StageData(cfg, recipe.streams)
    base = model.base_identity(cfg.model)
    parent = parent or origin(cfg, stage, data, base)
    this = run_of(cfg, stage, data, base, parent_id(parent))
    if cfg.output.overwrite and first_process():
        this.clear()
    if this.finished:
        _say(f"finished before: {this.folder} (output.overwrite=true repeats it)")
        return this
    processes = count(cfg)
    accumulation = schedule.accumulation(cfg.trainer, processes // cfg.trainer.context_parallel)
    check_memory(cfg, stage, data.cache.about)
    content = checkpoint.read(this)
    data.first, data.total = checkpoint.step_of(content), schedule.total_steps(recipe, data.steps_per_epoch)
    module = Module(cfg, recipe, network.build(cfg, tuple(recipe.streams)), data.total)
    module.tokens = data.tokens
    if parent is not None and content is None:
        inherit(module, parent, base)
    module.guard = Guard(this.folder)
    if first_process():
        this.begin(cfg)
    _say(f"stage {stage}: {this.folder}, step {data.first} of {data.total}" + (f", from {parent}" if parent else ""))
    callbacks, ending = _callbacks(module, data, Restore(this, content), this, str(parent or ""))
    trainer = _trainer(module, data, this, processes, accumulation, callbacks)
    trainer.fit(module, datamodule=data)
    if data.first == data.total:
        ending.late(trainer, module, data)
    _say(f"finished: {this.folder}")
    return this


# Where a stage starts from


def origin(cfg: TrainConfig, stage: int, data: StageData, base: str) -> Path | None:
    """The folder of the run whose weights a stage starts from, or None for the base; raises ValueError."""
    if cfg.init_from == "none" or (cfg.init_from == "auto" and stage == 1):
        return None
    if cfg.init_from != "auto":
        return Path(cfg.init_from).expanduser()
    wanted = wanted_before(cfg, stage, data, base)
    if not wanted.finished:
        raise ValueError(runs.parent_missing(wanted))
    return wanted.folder


def wanted_before(cfg: TrainConfig, stage: int, data: StageData, base: str) -> Run:
    """The run of the stage before, as this configuration would train it."""
    before = stage - 1
    parent = "" if before == 1 else wanted_before(cfg, before, data, base).id
    return run_of(cfg, before, data, base, parent)


def run_of(cfg: TrainConfig, stage: int, data: StageData, base: str, parent: str) -> Run:
    """The run of a stage; its folder need not be there."""
    clips = identity.of_clips(data.cache, data.train_clips)
    content = identity.content(cfg, stage, base, clips, parent)
    return Run(Path(cfg.output.folder).expanduser() / runs.name(stage, identity.digest(content)), stage, content)


def parent_id(folder: Path | None) -> str:
    """The id of the run in a folder, or of weights from elsewhere; raises ValueError when there are none."""
    if folder is None:
        return ""
    _, about = trained.read(folder)
    found: str = about.get("id") or trained.find(folder).parent.name
    return found


def inherit(module: Module, folder: Path, base: str) -> None:
    """Start from the trained weights in a folder; raises ValueError for those of another base, or that do not fit."""
    tensors, about = trained.read(folder)
    trained.check_base(about, base, folder)
    trained.apply(module.transformer, trained.part(tensors, trained.TRANSFORMER))
    maps = trained.part(tensors, trained.CONSTITUTIVE)
    if module.constitutive is not None and maps:
        module.constitutive.load_state_dict(maps)


# Lightning


def count(cfg: TrainConfig) -> int:
    """Processes of a training: devices of all machines."""
    import torch

    t = cfg.trainer
    return (t.devices or (torch.cuda.device_count() if _on_cuda(t) else 1)) * t.nodes


def check_memory(cfg: TrainConfig, stage: int, about: Mapping[str, Any]) -> None:
    """Raise ValueError, naming the way out, when the clips of a cache that says `about` do not fit on a CUDA device."""
    import torch

    if _on_cuda(cfg.trainer):
        there = torch.cuda.get_device_properties(0).total_memory
        planner.check(replace(cfg, stage=stage), about, there)


def _on_cuda(t: TrainerConfig) -> bool:
    import torch

    return t.accelerator in ("gpu", "auto") and torch.cuda.is_available()


def _trainer(
    module: Module, data: StageData, this: Run, processes: int, accumulation: int, callbacks: list[Callback]
) -> Trainer:
    """What runs the loop; checkpoints, progress, validation at the ends and samplers are ours."""
    t = module.cfg.trainer
    _quieten()
    every = t.val_steps if data.val_clips else 0
    return Trainer(
        accelerator=t.accelerator, devices=processes // t.nodes, num_nodes=t.nodes, precision=t.precision,  # type: ignore[arg-type]
        strategy=DDPStrategy(gradient_as_bucket_view=True, broadcast_buffers=False) if processes > 1 else "auto",
        max_epochs=1, max_steps=data.total, accumulate_grad_batches=accumulation,
        val_check_interval=every * accumulation or None, check_val_every_n_epoch=None,
        limit_val_batches=1.0 if every else 0, num_sanity_val_steps=0, inference_mode=False,
        use_distributed_sampler=False, enable_checkpointing=False, enable_progress_bar=False,
        enable_model_summary=False, log_every_n_steps=1, default_root_dir=this.folder,
        logger=loggers.build(module.cfg, this, data.first), callbacks=callbacks,
    )  # fmt: skip


def _callbacks(
    module: Module, data: StageData, restore: Restore, this: Run, parent: str
) -> tuple[list[Callback], Ending]:
    """In the order in which they see a step: the average is updated before it is saved, the clock is last."""
    t = module.cfg.trainer
    curves = Curves(t.log_steps, data.steps_per_epoch)
    ema = Ema(t.ema) if t.ema else None
    ending = Ending(this, curves, ema, parent, data.cache.about)
    saver = Saver(this.checkpoint, t.save_minutes, t.save_steps, data.steps_per_epoch)
    sampled = panel.build(module.cfg, data, this.folder)
    profile = [Profile(this.folder, t.profile_steps)] if t.profile_steps else []
    shown = [curves, *([sampled] if sampled else []), Bar(f"stage {this.stage}", curves)]
    first: list[Callback] = [restore, *([ema] if ema else []), *profile]
    return [*first, *shown, saver, ending, Departure(curves.clock)], ending


def _quieten() -> None:
    """Let Lightning tell only what goes wrong."""
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    for message in (r".*LeafSpec", r".*does not have many workers", r".*limit_val_batches"):
        warnings.filterwarnings("ignore", message=message)


def first_process() -> bool:
    """Whether this is the first process of a training, which alone writes and tells."""
    return rank() == 0


def _say(text: str) -> None:
    """Print in the first process."""
    if first_process():
        print(text, file=sys.stdout, flush=True)
