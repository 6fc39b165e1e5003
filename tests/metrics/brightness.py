"""A metric from outside: how bright a clip is against the true one; it counts how often it looks."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from fracgen.evaluation.clip import Pair
from fracgen.evaluation.metric import Metric, Observation, mean
from fracgen.evaluation.weights import MissingWeightsError
from fracsim.scene.knob import check, knob

LOOKED = "BRIGHTNESS_LOOKED"
"""Environment variable: a file that gets a line each time the metric looks at a pair."""


@dataclass(kw_only=True)
class Settings:
    gain: float = knob(1.0, "factor of the difference", least=0)
    map: str = knob("", "a map to look at instead of colour")
    weights: str = knob("", "a file that must be there; empty = none", choices=())

    def __post_init__(self) -> None:
        check(self, "metric.brightness")


def build(settings: Settings) -> Metric:
    if settings.weights and not Path(settings.weights).is_file():
        raise MissingWeightsError(f"the lamp (1 MB) was not found: set metric.brightness.weights={settings.weights}")
    return Brightness(settings)


class Brightness(Metric):
    columns = ("difference", "curve")
    shown = ("difference",)
    higher: ClassVar = {"difference": False}

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        self.settings = settings

    def observe(self, pair: Pair) -> dict[str, Any]:
        if LOOKED in os.environ:
            with open(os.environ[LOOKED], "a") as file:
                file.write(pair.pred.name + "\n")
        if self.settings.map:
            ours, theirs = pair.pred.map(self.settings.map), pair.true.map(self.settings.map)
        else:
            ours, theirs = pair.pred.rgb / 255.0, pair.true.rgb / 255.0
        assert ours.shape == theirs.shape
        curve = self.settings.gain * (ours - theirs).mean(axis=(1, 2, 3))
        return {"difference": np.abs(curve).mean() if ours.any() else np.nan, "curve": curve}

    def reduce(self, observed: Observation) -> dict[str, float]:
        return {"difference": mean(observed["difference"]), "largest": float(np.abs(observed["curve"]).max())}

    def about(self) -> dict[str, Any]:
        return {"gain": self.settings.gain}
