"""Peak signal-to-noise ratio of colour [dB]; higher is better.

`psnr` is the mean over frames of each frame's own ratio, `psnr_gen` the same without frame 0, and `psnr_clip` the ratio
of the error of all frames pooled, which is never larger than their mean (Jensen's inequality).
"""

from dataclasses import dataclass

import numpy as np

from fracgen.evaluation.clip import Pair
from fracgen.evaluation.per_frame import PerFrame
from fracsim.records import Array
from fracsim.scene.knob import check, knob


@dataclass(kw_only=True)
class Settings:
    """How the ratio is taken."""

    cap: float = knob(100.0, "largest ratio of a frame: equal ones have an infinite one, which no mean bears", "dB",
                      least=1, most=1000)  # fmt: skip

    def __post_init__(self) -> None:
        check(self, "metric.psnr")


class Psnr(PerFrame):
    """See above."""

    name, extra, better = "psnr", ("psnr_clip",), True

    def __init__(self, cap: float) -> None:
        super().__init__()
        self.cap = cap

    def ratio(self, square: Array) -> Array:
        """Ratios [dB] of mean squared errors of pixels in [0, 1], of any shape; at most the cap."""
        return np.asarray(-10 * np.log10(np.maximum(square, 10 ** (-self.cap / 10))))

    def scores(self, pred: Array, true: Array) -> Array:
        """The ratio of each frame of two videos (T, H, W, 3) uint8 [dB], (T,)."""
        return self.ratio(squares(pred, true))

    def observe(self, pair: Pair) -> dict[str, float]:
        """The three ratios of a pair [dB]; raises LackingError without colour or without a true clip."""
        pooled = float(self.ratio(squares(pair.pred.rgb, pair.true.rgb).mean()))
        return super().observe(pair) | {"psnr_clip": pooled}

    def about(self) -> dict[str, float]:
        """The cap."""
        return {"cap_db": self.cap}


def squares(pred: Array, true: Array) -> Array:
    """Mean squared error of each frame of two videos (T, H, W, 3) uint8, of pixels in [0, 1], (T,)."""
    return np.array([((a.astype(np.int32) - b) ** 2).mean() for a, b in zip(pred, true, strict=True)]) / 255**2


def build(settings: Settings) -> Psnr:
    """The metric."""
    return Psnr(settings.cap)
