"""The clips of a whole stage as one stream, from any optimiser step on.

Lightning then sees a single epoch that ends with the stage, and a run that goes on is a stream that begins later. So
nothing of Lightning's own resuming is needed, which forgets the order of shuffled clips (its issue 21938) and the
validation of an interrupted epoch (19549).
"""

from collections.abc import Iterator, Sequence

from torch.utils.data import DataLoader, Sampler

from fracgen.config.train import TrainConfig
from fracgen.data import Batch, DataModule, Place
from fracgen.data.sampler import KeyedSampler


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

    def train_dataloader(self) -> DataLoader[Batch]:
        """The training clips of this rank, a forward pass a batch."""
        trainer, (rank, ranks) = self.cfg.trainer, self._ranks()
        keyed = KeyedSampler(self.train_clips, self.cfg.seed, trainer.batch, trainer.effective_batch, rank, ranks)
        return self._loader(Stream(keyed, self.first, self.total), trainer.batch)
