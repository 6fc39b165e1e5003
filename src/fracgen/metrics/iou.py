"""Overlap of the predicted object with the true one, as Physics-IQ (Motamed et al.) has it; higher is better.

Of masks A and B (T, H, W) of the object:

* `iou_spatial`, where: the overlap of the pixels that the object covers in any frame.
* `iou_spatiotemporal`, where and when: the overlap in each frame, its mean over frames.
* `iou_weighted`, where and how long: sum min(a, b) / sum max(a, b), a and b the part of the frames in which each pixel
  is covered.
* `mse_rgb`: the mean squared error of colour in [0, 1]; lower is better.

Physics-IQ takes what moves for the mask, here it is the object: by alpha where both clips have one, else by colour in
both, since the two differ by half a pixel along the outline. Where neither clip shows an object it is NaN.
"""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from fracgen.evaluation.clip import ALPHA, Clip, Pair
from fracgen.evaluation.foreground import COVERED, foreground
from fracgen.evaluation.metric import Metric, mean
from fracgen.layout import RGB
from fracsim.records import Array
from fracsim.scene.knob import check, knob


@dataclass(kw_only=True)
class Settings:
    """From what the masks come."""

    by: str = knob("auto", "masks by alpha or by colour; auto = by alpha where both clips have one",
                   choices=("auto", "alpha", "colour"))  # fmt: skip

    def __post_init__(self) -> None:
        check(self, "metric.iou")


class Iou(Metric):
    """See above."""

    columns = ("iou_spatial", "iou_spatiotemporal", "iou_weighted", "mse_rgb", "by_alpha")
    shown = columns
    higher = MappingProxyType({**dict.fromkeys(columns[:3], True), "mse_rgb": False})

    def __init__(self, by: str) -> None:
        super().__init__()
        self.by = by

    def observe(self, pair: Pair) -> dict[str, float]:
        """The overlaps of a pair, and whether alpha gave the masks; raises LackingError without what they come from."""
        both = pair.pred.has(ALPHA) and pair.true.has(ALPHA)
        by_alpha = self.by == ALPHA or (self.by == "auto" and both)
        pred, true = (_masks(clip, by_alpha) for clip in (pair.pred, pair.true))
        return {
            "iou_spatial": overlap(np.any(pred, axis=0), np.any(true, axis=0)),
            "iou_spatiotemporal": mean(np.array([overlap(a, b) for a, b in zip(pred, true, strict=True)])),
            "iou_weighted": overlap(pred.mean(axis=0), true.mean(axis=0)),
            "mse_rgb": _error(pair) if pair.pred.has(RGB) and pair.true.has(RGB) else float("nan"),
            "by_alpha": float(by_alpha),
        }

    def about(self) -> dict[str, Any]:
        """From what the masks come."""
        return {"by": self.by, "alpha": f"> {COVERED}"}


def overlap(a: Array, b: Array) -> float:
    """The sum of minima over that of maxima of weights (H, W) in [0, 1], for masks the intersection over the union.

    NaN where both are 0 everywhere.
    """
    union = float(np.maximum(a, b).sum())
    return float(np.minimum(a, b).sum()) / union if union else float("nan")


def _masks(clip: Clip, by_alpha: bool) -> Array:
    """The object in each frame of a clip, (T, H, W) bool."""
    return np.asarray(clip.alpha > COVERED) if by_alpha else np.stack([foreground(frame) for frame in clip.rgb])


def _error(pair: Pair) -> float:
    """The mean squared error of colour in [0, 1]."""
    frames = zip(pair.pred.rgb, pair.true.rgb, strict=True)
    return float(np.mean([((a.astype(np.int32) - b) ** 2).mean() for a, b in frames]) / 255**2)


def build(settings: Settings) -> Iou:
    """The metric."""
    return Iou(settings.by)
