"""What FVD and KVD have in common: a distance between the features of predicted and of true clips.

All frames count, and again a shorter clip of 16 frames, as most published numbers do. Neither number compares with one
of another n, network or number of frames, so that all of these stand beside it.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fracgen.evaluation.clip import Pair
from fracgen.evaluation.metric import Metric, Observation
from fracgen.features._shared import reader
from fracgen.features._video import strided
from fracgen.layout import RGB
from fracsim.records import Array
from fracsim.scene.knob import knob


@dataclass(kw_only=True)
class FeatureSettings:
    """The network, and which frames it sees."""

    extractor: str = knob("i3d_wheel", "network of the features", package="fracgen.features")
    weights: str = knob("", "file of its weights; empty = where it looks for them by itself")
    device: str = knob("auto", "where the network runs", choices=("auto", "cpu", "cuda", "mps"))
    short: int = knob(16, "frames of a second, shorter clip, a constant stride apart; 0 = none", least=0, most=10000)
    keep: bool = knob(True, "keep features of true clips in the cache folder, for the next evaluation")


class FeatureDistance(Metric):
    """A distance whose observations are the features of a pair of clips."""

    title: ClassVar[str]
    """The name of the result."""
    needs = (RGB,)
    resamples: ClassVar[int] = 50
    """A resample of thousands of clips takes up to a second."""

    def __init__(self, settings: FeatureSettings, section: str) -> None:
        self.short, self.keep_true = settings.short, settings.keep
        self.columns = ("pred", "gt", "pred_short", "gt_short") if self.short else ("pred", "gt")
        self.higher = {self.title: False, f"{self.title}{self.short}": False}
        super().__init__()
        self.reader = reader(settings.extractor, settings.weights, settings.device, section)
        if 0 < self.short < self.reader.least:
            raise ValueError(f"{section}.short={self.short} is not allowed: {settings.extractor} needs at least "
                             f"{self.reader.least} frames; set {section}.short=16, or 0 for none.")  # fmt: skip

    @abstractmethod
    def distance(self, x: Array, y: Array) -> float:
        """The distance of predicted and true features, (n, D) float64 both, of the same n pairs; NaN if undefined."""

    def observe(self, pair: Pair) -> dict[str, Array]:
        """Features (D,) of both clips, and of their shorter versions, NaN where there are fewer frames.

        Raises LackingError for a clip without colour or with too few frames for the network.
        """
        frames = np.arange(len(pair.pred.rgb))
        pred, gt = self._features(pair, frames)
        if not self.short:
            return {"pred": pred, "gt": gt}
        undefined = np.full_like(pred, np.nan)
        some = strided(len(frames), self.short)
        short = self._features(pair, some) if some is not None else (undefined, undefined)
        return {"pred": pred, "gt": gt, "pred_short": short[0], "gt_short": short[1]}

    def _features(self, pair: Pair, frames: Array) -> tuple[Array, Array]:
        """Predicted and true features (D,) of frames (K,); only true clips come again, so that only they are kept."""
        return self.reader.vector(pair.pred, frames), self.reader.vector(pair.true, frames, self.keep_true)

    def reduce(self, observed: Observation) -> dict[str, float]:
        """The distances of n pairs, each with its n; observations are (n, D)."""
        results = self._of("", observed["pred"], observed["gt"])
        if self.short:
            results |= self._of(str(self.short), observed["pred_short"], observed["gt_short"])
        return results

    def _of(self, frames: str, pred: Array, gt: Array) -> dict[str, float]:
        pred, gt = self.defined(pred, gt)
        value = self.distance(pred, gt) if len(pred) > 1 else float("nan")
        return {f"{self.title}{frames}": value, f"{self.title}{frames}_n": len(pred)}

    @staticmethod
    def defined(pred: Array, gt: Array) -> tuple[Array, Array]:
        """The pairs (n, D) both of whose features are finite."""
        finite = np.isfinite(pred).all(1) & np.isfinite(gt).all(1)
        return pred[finite], gt[finite]

    def about(self) -> dict[str, Any]:
        """The network, its weights and their sha256, and the frames that it sees."""
        shorter = {"short": f"{self.short} frames, the largest constant stride"} if self.short else {}
        return {**self.reader.about, "frames": "all", **shorter}
