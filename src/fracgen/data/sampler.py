"""The order of training clips: a pure function of (seed, epoch, position), whatever the number of processes.

Lightning restores no order of a shuffled loader with workers (its issue 21938), and seeds all ranks alike (16166). Here
nothing needs to be restored: a run that goes on is told how many optimiser steps are done.
"""

from collections.abc import Iterator, Sequence

import torch
from torch.utils.data import Sampler

from fracgen import draws
from fracgen.data.cache import Place


class KeyedSampler(Sampler[Place]):
    """The places of this rank's clips in order: of each effective batch, positions rank, rank + ranks, ...

    So the union over ranks of an optimiser step is what one process would have used in it, and any whole number of
    forward passes makes a step. An epoch is filled up to whole effective batches with its own first clips: then all
    steps weigh their clips alike, and no clip is left out of an epoch.
    """

    def __init__(
        self, numbers: Sequence[int], seed: int, batch: int, effective_batch: int, rank: int = 0, ranks: int = 1
    ) -> None:
        """`numbers` are those of the clips in the cache, `batch` is the clips of one forward pass of a rank.

        Raises ValueError when an effective batch is no whole number of forward passes of all ranks, or has more clips
        than there are.
        """
        _check(len(numbers), batch, effective_batch, ranks)
        self.numbers, self.seed, self.effective_batch = list(numbers), seed, effective_batch
        self.rank, self.ranks = rank, ranks
        self.epoch = 0
        self._steps_done = 0

    @property
    def steps(self) -> int:
        """Optimiser steps of an epoch."""
        return -(-len(self.numbers) // self.effective_batch)

    def order(self, epoch: int) -> list[Place]:
        """The places of an epoch, effective batch by effective batch, for all ranks."""
        shuffle = torch.randperm(len(self.numbers), generator=draws.generator(self.seed, epoch, "order")).tolist()
        filled = shuffle + shuffle[: self.steps * self.effective_batch - len(shuffle)]
        return [Place(self.numbers[k], epoch, n % self.effective_batch) for n, k in enumerate(filled)]

    def start(self, epoch: int, steps: int = 0) -> None:
        """Let the next iteration begin in an epoch, after optimiser steps that are done already.

        There is no `set_epoch`, because Lightning would call it: after a stop by max_steps it counts the epoch that was
        stopped as done. The sampler goes to the next epoch when it has given out the clips of this one.
        """
        self.epoch, self._steps_done = epoch, steps

    def __iter__(self) -> Iterator[Place]:
        rest = self.order(self.epoch)[self._steps_done * self.effective_batch :]
        yield from rest[self.rank :: self.ranks]  # an effective batch is a multiple of `ranks`
        self.start(self.epoch + 1)

    def __len__(self) -> int:
        """Clips of this rank in an epoch, also of one that goes on in its middle."""
        return self.steps * self.effective_batch // self.ranks


def _check(clips: int, batch: int, effective_batch: int, ranks: int) -> None:
    if effective_batch % (batch * ranks):
        raise ValueError(f"trainer.effective_batch={effective_batch} must be a multiple of trainer.batch x devices = "
                         f"{batch} x {ranks}, so that a step is a whole number of forward passes: set it to "
                         f"{-(-effective_batch // (batch * ranks)) * batch * ranks}.")  # fmt: skip
    if clips < effective_batch:
        raise ValueError(f"{clips} training clips are fewer than trainer.effective_batch={effective_batch}: encode "
                         f"more clips, or set trainer.effective_batch to at most {clips}.")  # fmt: skip
