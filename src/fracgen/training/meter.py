"""Means over many steps without waiting for the device: sums stay there until they are asked for."""

from collections.abc import Mapping

import torch
import torch.distributed as dist
from torch import Tensor

BINS = 10
"""Noise levels are logged in so many equal parts of [0, 1]."""


LABELS = tuple(f"/{k / BINS:.1f}-{(k + 1) / BINS:.1f}" for k in range(BINS))


class Meter:
    """Weighted means by name; `add` never waits for the device, `means` does, once."""

    def __init__(self) -> None:
        self._sums: dict[str, Tensor] = {}
        self.last: dict[str, float] = {}
        """How many values were in each of the last means."""

    def add(self, name: str, values: Tensor) -> None:
        """Add values, any shape, of which the mean is wanted."""
        values = values.detach().float()
        self._add(name, torch.stack([values.sum(), torch.full_like(values.sum(), values.numel())]).unsqueeze(1))

    def add_by_level(self, name: str, values: Tensor, sigma: Tensor) -> None:
        """Add values [B] of clips at noise levels [B]: a mean for each bin of noise levels is wanted."""
        pair = torch.zeros(2, BINS, device=values.device)
        pair.index_add_(1, _bins(sigma), torch.stack([values.detach().float(), torch.ones_like(sigma)]))
        self._add(name, pair)

    def add_histogram(self, name: str, sigma: Tensor) -> None:
        """Add noise levels [B]: the share of each bin is wanted."""
        pair = torch.zeros(2, BINS, device=sigma.device)
        pair[0].index_add_(0, _bins(sigma), torch.ones_like(sigma))
        pair[1] = len(sigma)
        self._add(name, pair)

    def _add(self, name: str, pair: Tensor) -> None:
        """Add sums and counts, [2, N], of the entries of a name: one, or one for each bin."""
        self._sums[name] = self._sums[name] + pair if name in self._sums else pair

    def means(self) -> dict[str, float]:
        """The means over all processes, which call this together; the meter begins anew. Entries without a value are
        left out."""
        if not self._sums:
            return {}
        names = [f"{name}{label}" for name, pair in self._sums.items()
                 for label in (LABELS if pair.shape[1] > 1 else ("",))]  # fmt: skip
        sums, counts = _over_processes(torch.cat(list(self._sums.values()), dim=1)).tolist()
        self._sums, self.last = {}, dict(zip(names, counts, strict=True))
        return {name: s / n for name, s, n in zip(names, sums, counts, strict=True) if n}

    def state(self) -> dict[str, Tensor]:
        """Sums and counts over all processes, which call this together; from now on the first one holds them."""
        for name, pair in self._sums.items():
            total = _over_processes(pair)
            first = not (dist.is_available() and dist.is_initialized()) or dist.get_rank() == 0
            self._sums[name] = total if first else torch.zeros_like(total)
        return dict(self._sums)

    def load(self, state: Mapping[str, Tensor]) -> None:
        """Go on from a state; only the first process does, since it has the sums of all."""
        first = not (dist.is_available() and dist.is_initialized()) or dist.get_rank() == 0
        self._sums = {name: pair if first else torch.zeros_like(pair) for name, pair in state.items()}

    def to(self, device: torch.device) -> None:
        """Move the sums to a device."""
        self._sums = {name: pair.to(device) for name, pair in self._sums.items()}


def _bins(sigma: Tensor) -> Tensor:
    """The bin of each noise level, [B]."""
    return (sigma * BINS).long().clamp(0, BINS - 1)


def _over_processes(sums: Tensor) -> Tensor:
    """Sums over all processes, any shape."""
    if dist.is_available() and dist.is_initialized():
        sums = sums.clone()
        dist.all_reduce(sums)
    return sums
