"""Videos of fixed clips of the validation, sampled from fixed noise: what the network makes of them beside the truth.

    force           | predicted colour | true colour
    predicted flow  | strain | stress  | damage
    true flow       | strain | stress  | damage

They need the VAE of the cache, which waits in the memory of the host between validations. The noise levels are those
of the training (loss.shift).
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning import Callback, LightningModule, Trainer
from lightning.pytorch.loggers import WandbLogger
from torch import Tensor

from fracgen import flow, vae
from fracgen.config.train import LARGE_VAE, TrainConfig
from fracgen.data import Batch, LatentCache, collate
from fracgen.layout import MAPS, RGB, split
from fracgen.sampling.generate import initial, sample
from fracgen.training import noising
from fracgen.training.curves import log
from fracgen.training.module import Module
from fracgen.training.stream import StageData
from fracgen.vae import FrozenVae
from fracsim.records import Array
from fracsim.sample.video import Encoder

LUMA = (0.2126, 0.7152, 0.0722)
"""Weights of red, green and blue in luminance (Rec. 709)."""


def build(cfg: TrainConfig, data: StageData, folder: Path) -> "Mosaic | None":
    """The callback, or None when no videos are wanted or there is nothing to decode them with, which is said.

    Raises ValueError for another VAE than that of the cache.
    """
    clips = data.val_clips[: cfg.logger.videos] if cfg.trainer.val_steps else []
    if not clips:
        return None
    if not cfg.vae.path and cfg.vae.kind == "wan" and cfg.vae.base_dim > LARGE_VAE:
        print("no videos of the validation: vae.path is not set (logger.videos=0 silences this)", file=sys.stderr)
        return None
    decoder = vae.load(cfg.vae)
    if decoder.identity != data.cache.about["vae"]:
        raise ValueError(f"vae.path={cfg.vae.path or 'random weights'} is VAE {decoder.identity}, but the latents "
                         f"in data.folder={cfg.data.folder} were made by {data.cache.about['vae']}: give that VAE, or "
                         "set logger.videos=0.")  # fmt: skip
    return Mosaic(decoder, data.cache, clips, folder / "videos", cfg)


class Mosaic(Callback):
    """Samples, decodes and shows clips at the end of each validation, with averaged weights where there are such."""

    def __init__(
        self, decoder: FrozenVae, cache: LatentCache, clips: list[int], folder: Path, cfg: TrainConfig
    ) -> None:
        self.decoder, self.cache, self.clips, self.folder, self.cfg = decoder, cache, clips, folder, cfg

    def on_validation_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Each process makes its share of the videos; the first one shows them."""
        assert isinstance(pl_module, Module)
        _move(self.decoder, pl_module.device)
        place = self.folder / f"step-{trainer.global_step:06}"
        place.mkdir(parents=True, exist_ok=True)
        jumps = [self._one(trainer, pl_module, number, place)
                 for number in self.clips[trainer.global_rank :: trainer.world_size]]  # fmt: skip
        _move(self.decoder, torch.device("cpu"))
        trainer.strategy.barrier("videos")
        if trainer.is_global_zero:
            _show(trainer, sorted(place.glob("*.mp4")))
            if jumps:
                means = np.mean(jumps, axis=0)
                log(trainer, {"video/luminance_jump": float(means[0]), "video/luminance_jump_true": float(means[1])})

    def _one(self, trainer: Trainer, module: Module, number: int, place: Path) -> tuple[float, float]:
        """Make the video of a clip, and return how much its luminance changes from frame 0 to 1, predicted and true."""
        batch = _to(collate([self.cache[number]]), module.device)
        with torch.no_grad(), trainer.precision_plugin.forward_context():
            predicted = predict(module, batch)
        videos = {f"predicted {name}": z for name, z in predicted.items()}
        videos |= {f"true {name}": z for name, z in batch.latents.items()} | {"force": batch.force}
        pictures = {name: _pixels(self.decoder, z) for name, z in videos.items()}
        frames = arrange(pictures, tuple(predicted))
        with Encoder(place / f"{batch.ids[0]}.mp4", frames.shape[2], frames.shape[1], "strip") as encoder:
            for frame in frames:
                encoder.write(frame)
        return luminance_jump(pictures[f"predicted {RGB}"]), luminance_jump(pictures[f"true {RGB}"])


def predict(module: Module, batch: Batch) -> Mapping[str, Tensor]:
    """The latents by stream, [1, 16, T, H, W] each, that the network makes of the conditions of a clip."""
    cfg = module.cfg
    inputs = noising.inputs(batch, cfg.conditioning, cfg.seed, train=False)
    start = initial(inputs, cfg.seed, batch.indices.tolist()).to(batch.force.device)
    levels = flow.levels(cfg.logger.video_steps, cfg.loss.shift)
    return split(sample(module.transformer, start, inputs, levels), module.streams)


def arrange(pictures: Mapping[str, Array], streams: tuple[str, ...]) -> Array:
    """The frames of a mosaic, (F, rows h, columns w, 3), of videos (F, h, w, 3); tiles without a video are black."""
    rows = [["force", f"predicted {RGB}", f"true {RGB}"]]
    if len(streams) > 1:
        rows += [[f"{kind} {name}" for name in MAPS] for kind in ("predicted", "true")]
    columns = max(len(row) for row in rows)
    black = np.zeros_like(pictures["force"])
    tiles = [[pictures.get(name, black) for name in [*row, *[""] * (columns - len(row))]] for row in rows]
    return np.concatenate([np.concatenate(row, axis=2) for row in tiles], axis=1)


def luminance_jump(video: Array) -> float:
    """Change of the mean luminance, in [0, 1], from frame 0 to frame 1 of a video (F, h, w, 3) of bytes; 0 for one
    frame. A faulty first frame shows here."""
    first = video[:2].mean(axis=(1, 2)) @ np.array(LUMA) / 255
    return float(abs(first[-1] - first[0]))


def _pixels(decoder: FrozenVae, latent: Tensor) -> Array:
    """The frames (F, h, w, 3), bytes, of a latent [1, 16, T, H, W]."""
    video = decoder.decode(latent.float())[0].permute(1, 2, 3, 0)
    return np.asarray((255 * video).round().byte().cpu().numpy())


def _move(decoder: FrozenVae, device: torch.device) -> None:
    """Move the VAE to a device."""
    decoder.network.to(device)
    decoder.mean, decoder.std = decoder.mean.to(device), decoder.std.to(device)


def _to(batch: Batch, device: torch.device) -> Batch:
    """A batch on a device, but for the keys of random draws."""
    moved: dict[str, Any] = {name: value.to(device) for name, value in batch._asdict().items()
                             if isinstance(value, Tensor) and name not in ("indices", "epoch", "slot")}  # fmt: skip
    return batch._replace(**moved, latents={name: z.to(device) for name, z in batch.latents.items()})


def _show(trainer: Trainer, files: list[Path]) -> None:
    """Hand the videos to wandb, if that is a logger."""
    for logger in trainer.loggers:
        if isinstance(logger, WandbLogger):
            for file in files:
                logger.log_video(f"video/{file.stem}", [str(file)], format=["mp4"])
