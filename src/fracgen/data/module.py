"""Feeds a trainer from a latent cache: what it needs is checked before training begins."""

import warnings
from collections.abc import Sequence
from typing import Any

import torch
from lightning import LightningDataModule
from torch.utils.data import DataLoader

from fracgen.config.train import TrainConfig
from fracgen.data.batch import Batch
from fracgen.data.cache import LatentCache, Place, collate, open
from fracgen.data.sampler import KeyedSampler

ZEROS = "zeros"
"""Identity of the encoder of pictures that gives none: the transformer then sees zeros."""


class DataModule(LightningDataModule):
    """Batches for training and validation, of the asked streams.

    Training clips come in the order of `KeyedSampler`, so that Lightning must leave the sampler alone
    (`use_distributed_sampler=False`). Validation clips come in the order of the cache; a rank gets every n-th.
    """

    def __init__(self, cfg: TrainConfig, streams: Sequence[str]) -> None:
        """Raises ValueError naming the field when the cache does not hold what this training needs."""
        super().__init__()
        self.cfg = cfg
        self.cache = open(cfg.data.folder).only(streams, image=cfg.model.image_dim > 0)
        data = cfg.data
        self.train_clips = self.cache.numbers(data.train_split, data.objects)[: data.limit or None]
        """Numbers of the training clips in the cache."""
        self.val_clips = self.cache.numbers(data.val_split, data.objects)[: data.val_limit or None]
        """Numbers of the validation clips in the cache."""
        _check_clips(self, cfg)
        _check_text(self.cache, cfg)
        _check_image(self.cache, self.train_clips[0], cfg)
        self._steps_done = 0
        self.sampler: KeyedSampler | None = None
        """The sampler of the last `train_dataloader`."""

    @property
    def steps_per_epoch(self) -> int:
        """Optimiser steps of an epoch."""
        return -(-len(self.train_clips) // self.cfg.trainer.effective_batch)

    def start(self, steps: int) -> None:
        """Go on after this number of optimiser steps, counted from the start of the training."""
        self._steps_done = steps
        if self.sampler is not None:
            self.sampler.start(*divmod(steps, self.steps_per_epoch))

    def train_dataloader(self) -> DataLoader[Batch]:
        """The training clips of this rank, a forward pass a batch."""
        trainer, (rank, ranks) = self.cfg.trainer, self._ranks()
        self.sampler = KeyedSampler(
            self.train_clips, self.cfg.seed, trainer.batch, trainer.effective_batch, rank, ranks
        )
        self.start(self._steps_done)
        return self._loader(self.sampler, trainer.batch)

    def val_dataloader(self) -> list[DataLoader[Batch]]:
        """The validation clips of this rank in a fixed order; no loader when there are none."""
        if not self.val_clips:
            return []
        rank, ranks = self._ranks()
        places = [Place(number, 0, slot) for slot, number in enumerate(self.val_clips)]
        # A rank without a clip would not take part in the mean over ranks.
        mine = places[rank::ranks] if len(places) >= ranks else places
        return [self._loader(mine, self.cfg.trainer.batch)]

    def _ranks(self) -> tuple[int, int]:
        """Number of this process, and how many there are."""
        return (self.trainer.global_rank, self.trainer.world_size) if self.trainer else (0, 1)

    def _loader(self, places: Any, batch: int) -> DataLoader[Batch]:
        workers = self.cfg.data.workers
        return DataLoader(self.cache, batch_size=batch, sampler=places, num_workers=workers, collate_fn=collate,
                          pin_memory=torch.cuda.is_available(), persistent_workers=workers > 0)  # fmt: skip


def _check_text(cache: LatentCache, cfg: TrainConfig) -> None:
    there = cache.about["text_dim"]
    if there != cfg.model.text_dim:
        raise ValueError(f"model.text_dim={cfg.model.text_dim}, but the captions of data.folder={cache.folder} have "
                         f"{there} channels: set model.text_dim={there}, or encode with "
                         f"text_dim={cfg.model.text_dim} into another folder.")  # fmt: skip


def _check_image(cache: LatentCache, clip: int, cfg: TrainConfig) -> None:
    """Raise ValueError when the model needs another embedding of the picture than that of a clip."""
    image, wanted = cache[clip].image, cfg.model.image_dim
    there = 0 if image is None else image.shape[-1]
    if wanted and cache.about["image"] == ZEROS:
        warnings.warn(f"data.folder={cache.folder} was encoded with encoders.image=zeros: the branch of the model for "
                      "the object's picture sees zeros.", stacklevel=3)  # fmt: skip
    elif there != wanted:
        raise ValueError(f"model.image_dim={wanted}, but the embeddings of the object's picture in "
                         f"data.folder={cache.folder} have {there} channels: encode with encoders.image=clip into "
                         f"another folder, or set model.image_dim={there}.")  # fmt: skip


def _check_clips(module: DataModule, cfg: TrainConfig) -> None:
    """Raise ValueError when there are fewer training clips than an effective batch; say what there is."""
    found, needed, data = len(module.train_clips), cfg.trainer.effective_batch, cfg.data
    if found >= needed:
        return
    splits = {s: len(module.cache.numbers(s)) for s in ("train", "test", "none")}
    there = ", ".join(f"{n} of split {split}" for split, n in splits.items() if n) or "none"
    chosen = f", of which {found} are of the chosen objects and within data.limit" if data.objects or data.limit else ""
    raise ValueError(f"trainer.effective_batch={needed} needs as many training clips, but data.folder={data.folder} "
                     f"has clips: {there}{chosen} (data.train_split={data.train_split}): encode more clips, or set "
                     f"trainer.effective_batch to at most {found}.")  # fmt: skip
