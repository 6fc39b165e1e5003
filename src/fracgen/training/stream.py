"""The clips of a whole stage as one stream, from any optimiser step on.

Lightning then sees a single epoch that ends with the stage, and a run that goes on is a stream that begins later. So
nothing of Lightning's own resuming is needed, which forgets the order of shuffled clips (its issue 21938) and the
validation of an interrupted epoch (19549).
"""

from collections.abc import Iterator, Sequence

import torch
from torch.utils.data import DataLoader, Sampler

from fracgen.config.train import TrainConfig
from fracgen.data import Batch, DataModule, Place
from fracgen.data.sampler import KeyedSampler
from fracgen.layout import PATCH, latent_frames, latent_size

KEYS = ("indices", "epoch", "slot")
"""Entries of a batch that stay on the CPU, where random numbers are drawn."""


class Stream(Sampler[Place]):
    """The places of this rank's clips in the optimiser steps `first` ... `total` - 1, in the order of `keyed`."""

    def __init__(self, keyed: KeyedSampler, first: int, total: int) -> None:
        self.keyed, self.first, self.total = keyed, first, total

    def __iter__(self) -> Iterator[Place]:
        known, order = -1, list[Place]()
        size = self.keyed.effective_batch
        for step in range(self.first, self.total):
            epoch, done = divmod(step, self.keyed.steps)
            if epoch != known:
                known, order = epoch, self.keyed.order(epoch)
            yield from order[done * size : (done + 1) * size][self.keyed.rank :: self.keyed.ranks]

    def __len__(self) -> int:
        return (self.total - self.first) * self.keyed.effective_batch // self.keyed.ranks


class StageData(DataModule):
    """The batches of a stage of `total` optimiser steps, of which `first` are done."""

    def __init__(self, cfg: TrainConfig, streams: Sequence[str]) -> None:
        """Raises ValueError naming the field when the cache does not hold what this training needs."""
        super().__init__(cfg, streams)
        self.first = self.total = 0

    @property
    def tokens(self) -> int:
        """Tokens of a clip, those of the reference among them."""
        about = self.cache.about
        w, h = latent_size(about["width"], about["height"])
        return (1 + latent_frames(about["frames"])) * len(self.cache.streams) * (h // PATCH) * (w // PATCH)

    def _ranks(self) -> tuple[int, int]:
        """Number of this process, and how many there are; those that share their clips count as one."""
        (rank, ranks), together = super()._ranks(), self.cfg.trainer.context_parallel
        return rank // together, ranks // together

    def transfer_batch_to_device(self, batch: Batch, device: torch.device, dataloader_idx: int) -> Batch:
        """All but the keys of random draws, which would have to wait for the device."""
        keys = {name: getattr(batch, name) for name in KEYS}
        moved: Batch = super().transfer_batch_to_device(batch, device, dataloader_idx)
        return moved._replace(**keys)

    def train_dataloader(self) -> DataLoader[Batch]:
        """The training clips of this rank, a forward pass a batch."""
        trainer, (rank, ranks) = self.cfg.trainer, self._ranks()
        keyed = KeyedSampler(self.train_clips, self.cfg.seed, trainer.batch, trainer.effective_batch, rank, ranks)
        return self._loader(Stream(keyed, self.first, self.total), trainer.batch)
