"""A metric from outside, for the tests of the callback: how bright clips are, and how far off their damage is."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fracgen.evaluation.clip import Pair
from fracgen.evaluation.metric import Metric
from fracsim.scene.knob import check, knob


@dataclass(kw_only=True)
class Settings:
    """How bright is bright."""

    times: float = knob(1.0, "factor of the brightness", least=0)

    def __post_init__(self) -> None:
        check(self, "metric.grey")


class Grey(Metric):
    """The mean of all bytes of the prediction and of the truth; undefined for clips of odd names."""

    columns = ("grey", "grey_true", "first")
    shown = ("grey", "grey_true")

    def __init__(self, times: float) -> None:
        super().__init__()
        self.times = times

    def observe(self, pair: Pair) -> dict[str, Any]:
        odd = int(pair.pred.name[-1]) % 2
        return {"grey": self.times * pair.pred.rgb.mean(), "grey_true": np.nan if odd else pair.true.rgb.mean(),
                "first": pair.pred.rgb[0].mean(axis=(0, 1))}  # fmt: skip


def build(settings: Settings) -> Metric:
    return Grey(settings.times)
