"""Fixed clips of the validation, sampled from fixed noise: decoded once, for the videos and for the metrics.

They need the VAE of the cache, which waits in the memory of the host between validations. The noise levels are those
of the training (loss.shift).
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from lightning import Callback, LightningModule, Trainer
from torch import Tensor

from fracgen import flow, vae
from fracgen.config.train import LARGE_VAE, TrainConfig
from fracgen.data import Batch, LatentCache, collate
from fracgen.layout import split
from fracgen.sampling.generate import initial, sample
from fracgen.training import decoded, mosaic, noising, scores
from fracgen.training.curves import log
from fracgen.training.module import Module
from fracgen.training.scores import Scores
from fracgen.training.stream import StageData
from fracgen.vae import FrozenVae

FOLDER = "videos"
"""Where videos and tables lie in the folder of a run."""
T = TypeVar("T")


def build(cfg: TrainConfig, data: StageData, folder: Path) -> "Panel | None":
    """The callback, or None when nothing is wanted or there is nothing to decode with, which is said.

    Raises ValueError for a metric that cannot be used, and for another VAE than that of the cache.
    """
    clips = data.val_clips if cfg.trainer.val_steps else []
    if not clips:
        return None
    measured = clips[: cfg.measure.clips]
    metrics = scores.build(cfg, data.cache.streams) if measured else {}
    shown = clips[: cfg.logger.videos]
    decoder = _decoder(cfg, data.cache, bool(shown), bool(metrics)) if shown or metrics else None
    if decoder is None:
        return None
    judge = Scores(metrics, measured, data.cache.rows) if metrics else None
    return Panel(decoder, data.cache, shown, judge, folder / FOLDER)


def _decoder(cfg: TrainConfig, cache: LatentCache, videos: bool, metrics: bool) -> FrozenVae | None:
    """The VAE of the cache; None, which is said, when its weights are not given."""
    wanted = " and no ".join([*["videos"] * videos, *["metrics"] * metrics])
    silence = " and ".join([*["logger.videos=0"] * videos, *["measure.clips=0"] * metrics])
    without = f"no {wanted} of the validation: vae.path is not set ({silence} silences this)"
    if not cfg.vae.path and cfg.vae.kind == "wan" and cfg.vae.base_dim > LARGE_VAE:
        print(without, file=sys.stderr)
        return None
    decoder = vae.load(cfg.vae)
    if decoder.identity == cache.about["vae"]:
        return decoder
    if not (cfg.vae.path or videos):
        print(without, file=sys.stderr)
        return None
    raise ValueError(f"vae.path={cfg.vae.path or 'random weights'} is VAE {decoder.identity}, but the latents in "
                     f"data.folder={cfg.data.folder} were made by {cache.about['vae']}: give that VAE, or set "
                     f"{silence}.")  # fmt: skip


class Panel(Callback):
    """Samples clips at the end of each validation, with averaged weights where there are such; shows and scores them.

    It is no part of the Lightning module, so that neither checkpoints nor averages of weights hold a metric or the VAE.
    """

    def __init__(
        self, decoder: FrozenVae, cache: LatentCache, shown: Sequence[int], judge: Scores | None, folder: Path
    ) -> None:
        """`shown` are the numbers of the clips of which videos are made."""
        self.decoder, self.cache, self.shown, self.judge, self.folder = decoder, cache, shown, judge, folder

    def on_validation_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Each process takes its share of the clips; the first one logs."""
        assert isinstance(pl_module, Module)
        measured = self.judge.clips if self.judge is not None and due(trainer, pl_module.cfg) else ()
        numbers = list(dict.fromkeys([*self.shown, *measured]))
        if trainer.sanity_checking or not numbers:
            return
        place = self.folder / f"step-{trainer.global_step:06}"
        place.mkdir(parents=True, exist_ok=True)
        _move(self.decoder, pl_module.device)
        together = pl_module.cfg.trainer.context_parallel
        mine = share(numbers, trainer.global_rank, trainer.world_size, together)
        jumps = [self._one(trainer, pl_module, number, measured, place) for number in mine]
        _move(self.decoder, torch.device("cpu"))
        trainer.strategy.barrier("panel")
        if trainer.is_global_zero and self.shown:
            mosaic.show(trainer, place)
        _log_jumps(trainer, [jump for jump in jumps if jump])
        if self.judge is not None and measured:
            self.judge.finish(trainer, place)

    def _one(
        self, trainer: Trainer, module: Module, number: int, measured: Sequence[int], place: Path
    ) -> tuple[float, float] | None:
        """Sample a clip, show it and score it, as is wanted.

        Returns how much the luminance of a shown clip changes from frame 0 to 1, predicted and true.
        """
        batch = _to(collate([self.cache[number]]), module.device)
        with torch.no_grad(), trainer.precision_plugin.forward_context():
            predicted = predict(module, batch)
        pair = decoded.pair(self.decoder, batch, predicted, self.cache.rows[number], self.cache.about)
        if self.judge is not None and number in measured:
            self.judge.observe(number, pair)
        if number not in self.shown:
            return None
        mosaic.write(pair, decoded.pixels(self.decoder, batch.force), place / f"{batch.ids[0]}.mp4")
        return mosaic.luminance_jump(pair.pred.rgb), mosaic.luminance_jump(pair.true.rgb)


def due(trainer: Trainer, cfg: TrainConfig) -> bool:
    """Whether this validation measures; it depends on the optimiser step alone, so that a run that goes on does as one
    that was not broken off."""
    done = trainer.global_step // cfg.trainer.val_steps
    return trainer.global_step == trainer.max_steps or done % cfg.measure.every_n_val == 0


def share(numbers: Sequence[T], rank: int, ranks: int, together: int) -> Sequence[T]:
    """What falls to a process, of which each `together` share their clips."""
    return numbers[rank // together :: ranks // together]


def predict(module: Module, batch: Batch) -> Mapping[str, Tensor]:
    """The latents by stream, [1, 16, T, H, W] each, that the network makes of the conditions of a clip."""
    cfg = module.cfg
    inputs = noising.inputs(batch, cfg.conditioning, cfg.seed, train=False)
    start = initial(inputs, cfg.seed, batch.indices.tolist()).to(batch.force.device)
    levels = flow.levels(cfg.logger.video_steps, cfg.loss.shift)
    return split(sample(module.transformer, start, inputs, levels), module.streams)


def _log_jumps(trainer: Trainer, jumps: Sequence[tuple[float, float]]) -> None:
    """Log how much the luminance of this process's clips changes at their start."""
    if jumps:
        means = np.mean(jumps, axis=0)
        log(trainer, {"video/luminance_jump": float(means[0]), "video/luminance_jump_true": float(means[1])})


def _move(decoder: FrozenVae, device: torch.device) -> None:
    """Move the VAE to a device."""
    decoder.network.to(device)
    decoder.mean, decoder.std = decoder.mean.to(device), decoder.std.to(device)


def _to(batch: Batch, device: torch.device) -> Batch:
    """A batch on a device, but for the keys of random draws."""
    moved: dict[str, Any] = {name: value.to(device) for name, value in batch._asdict().items()
                             if isinstance(value, Tensor) and name not in ("indices", "epoch", "slot")}  # fmt: skip
    return batch._replace(**moved, latents={name: z.to(device) for name, z in batch.latents.items()})
