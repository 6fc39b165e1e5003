"""The base of all metrics: observe a pair of clips, then reduce what was observed to numbers.

`observe` is the work, done once a clip, and what it returns is small and can be stored. `reduce` is cheap, so that it
runs for all clips, for each group of them, and for each resample of a bootstrap.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor
from torchmetrics import Metric as TorchMetric

from fracgen.evaluation.clip import Pair
from fracsim.records import Array

Observation = Mapping[str, Array]
"""Arrays of a fixed shape by name; NaN where a value is undefined."""


class Metric(TorchMetric, ABC):
    """A metric over pairs of clips, whose state is one row a clip, merged across processes by concatenation.

    As every metric of torchmetrics it has `update(pair)`, `compute()`, `reset()`.
    """

    full_state_update: ClassVar[bool] = False  # type: ignore[misc]
    needs: tuple[str, ...] = ()
    """Streams that both clips must have."""
    columns: tuple[str, ...] = ()
    """Names of what is observed, a state each."""
    shown: tuple[str, ...] = ()
    """Observations that are single numbers, shown a row a clip."""
    higher: Mapping[str, bool] = {}
    """Whether higher is better, by name of a result; absent where neither is."""

    resamples: ClassVar[int] = 10**6
    """Most resamples of a bootstrap, for what takes long to reduce."""
    of_sets: ClassVar[bool] = False
    """Whether a result is a distance between sets of clips that a clip twice in a set changes: resamples then show its
    spread, not where it lies."""

    def __init__(self) -> None:
        super().__init__()
        for name in self.columns:
            self.add_state(name, default=[], dist_reduce_fx="cat")

    @abstractmethod
    def observe(self, pair: Pair) -> dict[str, Any]:
        """A number or an array for each of `columns`; raises LackingError when a clip has not what is needed."""

    def reduce(self, observed: Observation) -> dict[str, float]:
        """Results of n clips, whose observations are stacked, (n, ...): here the means of what is defined."""
        return {name: mean(observed[name]) for name in self.shown}

    def about(self) -> dict[str, Any]:
        """What a result rests on beside the clips, as settings and weights with their sha256."""
        return {}

    def update(self, pair: Pair) -> None:
        """Observe a pair and keep it."""
        self.keep(self.observe(pair))

    def keep(self, observation: Mapping[str, Any]) -> None:
        """Take in what was observed, here or before."""
        for name in self.columns:
            rows: list[Tensor] = getattr(self, name)
            rows.append(torch.as_tensor(np.asarray(observation[name], np.float64))[None])

    def compute(self) -> dict[str, float]:
        """The results of all that was kept; empty without any."""
        kept = {name: getattr(self, name) for name in self.columns}
        if not all(len(rows) for rows in kept.values()):
            return {}
        return self.reduce({name: np.asarray(_stacked(rows).cpu()) for name, rows in kept.items()})


def mean(values: Array) -> float:
    """The mean of what is not NaN among values (n,); NaN when nothing is."""
    values = np.asarray(values, np.float64)
    defined = values[~np.isnan(values)]
    return float(defined.mean()) if defined.size else float("nan")


def _stacked(rows: list[Tensor] | Tensor) -> Tensor:
    """Rows of a state, one tensor already after a merge of processes."""
    return rows if isinstance(rows, Tensor) else torch.cat(rows)
