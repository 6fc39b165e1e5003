"""Means over many steps without waiting for the device: sums stay there until they are asked for."""

from collections.abc import Sequence

import torch
import torch.distributed as dist
from torch import Tensor

BINS = 10
"""Noise levels are logged in so many equal parts of [0, 1]."""


class Meter:
    """Weighted means by name; `add` never waits for the device, `means` does, once."""

    def __init__(self) -> None:
        self._sums: dict[str, Tensor] = {}
        self._labels: dict[str, Sequence[str]] = {}

    def add(self, name: str, values: Tensor) -> None:
        """Add values, any shape, of which the mean is wanted."""
        pair = torch.stack([values.detach().float().sum(), values.new_tensor(values.numel(), dtype=torch.float32)])
        self._add(name, pair.unsqueeze(1), ("",))

    def add_by_level(self, name: str, values: Tensor, sigma: Tensor) -> None:
        """Add values [B] of clips at noise levels [B]: a mean for each bin of noise levels is wanted."""
        where = (sigma * BINS).long().clamp(0, BINS - 1)
        pair = torch.zeros(2, BINS, device=values.device)
        pair.index_add_(1, where, torch.stack([values.detach().float(), torch.ones_like(sigma)]))
        self._add(name, pair, LABELS)

    def _add(self, name: str, pair: Tensor, labels: Sequence[str]) -> None:
        """Add sums and counts, [2, N], of the entries of a name."""
        if name in self._sums:
            self._sums[name] += pair
        else:
            self._sums[name], self._labels[name] = pair, labels

    def counts(self, name: str) -> list[float]:
        """How many values each entry of a name has got in this process."""
        found: list[float] = self._sums[name][1].tolist() if name in self._sums else []
        return found

    def means(self) -> dict[str, float]:
        """The means over all processes, which call this together; the meter begins anew. Entries without a value are
        left out."""
        if not self._sums:
            return {}
        together = torch.cat(list(self._sums.values()), dim=1)
        if dist.is_available() and dist.is_initialized():
            dist.all_reduce(together)
        names = [f"{name}{label}" for name, labels in self._labels.items() for label in labels]
        sums, counts = together.tolist()
        self._sums, self._labels = {}, {}
        return {name: s / n for name, s, n in zip(names, sums, counts, strict=True) if n}


LABELS = tuple(f"/{k / BINS:.1f}-{(k + 1) / BINS:.1f}" for k in range(BINS))
