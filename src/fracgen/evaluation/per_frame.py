"""Metrics that compare one picture with another: the mean over the frames of a clip, then over clips."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from fracgen.evaluation.clip import Pair
from fracgen.evaluation.metric import Metric, mean
from fracgen.layout import RGB
from fracsim.records import Array


class PerFrame(Metric):
    """Results: NAME, the mean over all frames, and NAME_gen, without frame 0, which a generator was shown.

    NAME_gen of a single picture is NaN.
    """

    name: ClassVar[str]
    extra: ClassVar[tuple[str, ...]] = ()
    """Results beside these two."""
    better: ClassVar[bool]
    """Whether a higher score is better."""
    needs = (RGB,)

    def __init__(self) -> None:
        self.columns = self.shown = (self.name, f"{self.name}_gen", *self.extra)
        self.higher = dict.fromkeys(self.columns, self.better)
        super().__init__()

    @abstractmethod
    def scores(self, pred: Array, true: Array) -> Array:
        """A number for each frame of two videos (T, H, W, 3) uint8, (T,)."""

    def observe(self, pair: Pair) -> dict[str, float]:
        """The means over frames of a pair; raises LackingError without colour or without a true clip."""
        scores = self.scores(pair.pred.rgb, pair.true.rgb)
        return {self.name: mean(scores), f"{self.name}_gen": mean(scores[1:])}


def tensor(frames: Array, like: torch.device, dtype: torch.dtype = torch.float32) -> Tensor:
    """Frames (T, H, W, 3) uint8 as pictures [T, 3, H, W] in [0, 1]: 4 axes, for 5 would mean volumes to some."""
    return torch.tensor(np.ascontiguousarray(frames)).to(like).permute(0, 3, 1, 2).to(dtype) / 255
