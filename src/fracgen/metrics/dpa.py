"""Damage progression alignment (DPA): whether damage passes shares of its own peak at the same times.

What the paper leaves open: frames count from 0; a clip whose peak is below `least_damage` has none, and then both
without score 1, one without scores 0; a damage map that was decoded from a video has a floor, which is taken off both
clips alike.
"""

from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from fracgen.evaluation.clip import Clip, Pair
from fracgen.evaluation.grey import DEADBAND, background, deadband, grey
from fracgen.evaluation.metric import Metric, Observation, mean
from fracgen.layout import DAMAGE
from fracsim.records import Array
from fracsim.scene.knob import check, knob

POINTS = 101
"""Length of the curves that are kept for plots: damage at 0, 1, ..., 100 % of a clip."""


@dataclass(kw_only=True)
class Settings:
    """Which times are compared, and what counts as damage."""

    checkpoints: list[float] = knob([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9], "shares of a clip's peak damage",
                                    least=0, most=1, open="least")  # fmt: skip
    sigma: float = knob(0.1, "difference in time, as a part of a clip, at which the score falls to 1/e", least=0,
                        open="least")  # fmt: skip
    least_damage: float = knob(1e-3, "a clip whose damage, as a mean over a picture, stays below this has none",
                               least=0, most=1)  # fmt: skip
    strict: bool = knob(False, "the paper's formula also for clips without damage")
    deadband: float = knob(DEADBAND, "damage less the background's median counts from here on; 0 = damage as it is",
                           "levels of 255", least=0, most=255)  # fmt: skip

    def __post_init__(self) -> None:
        check(self, "metric.dpa")
        if not self.checkpoints:
            raise ValueError("metric.dpa.checkpoints=[] leaves nothing to compare: give shares as [0.1,0.5,0.9].")


def build(settings: Settings) -> "Dpa":
    """The metric."""
    return Dpa(settings)


class Dpa(Metric):
    """DPA, and the curves it compares."""

    needs = (DAMAGE,)
    columns = ("dpa", "dpa_peak_pred", "dpa_peak_gt", "dpa_curve_pred", "dpa_curve_gt")
    """DPA; the largest total damage of both clips, as a mean over a picture; their curves, (POINTS,) each."""
    shown = ("dpa", "dpa_peak_pred", "dpa_peak_gt")
    higher = MappingProxyType({"dpa": True})

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        self.settings = settings

    def observe(self, pair: Pair) -> dict[str, Any]:
        """DPA of a pair; the background is where the true object is not in its first picture."""
        outside = background(pair.true)
        pred, gt = (self._curve(clip, outside) for clip in (pair.pred, pair.true))
        return {
            "dpa": score(pred, gt, self.settings), "dpa_peak_pred": pred.max(), "dpa_peak_gt": gt.max(),
            "dpa_curve_pred": resampled(pred), "dpa_curve_gt": resampled(gt),
        }  # fmt: skip

    def reduce(self, observed: Observation) -> dict[str, float]:
        """Means, and how many clips are without damage."""
        without = {f"dpa_undamaged_{who}": int((observed[f"dpa_peak_{who}"] < self.settings.least_damage).sum())
                   for who in ("pred", "gt")}  # fmt: skip
        return {**{name: mean(observed[name]) for name in self.shown}, **without}

    def about(self) -> dict[str, Any]:
        """All settings."""
        return asdict(self.settings)

    def _curve(self, clip: Clip, outside: Array) -> Array:
        return total(deadband(grey(clip.map(DAMAGE)), outside, self.settings.deadband))


def total(damage: Array) -> Array:
    """a(t), the mean of damage (T, H, W) over each picture, (T,) float64."""
    return np.asarray(damage.mean(axis=(1, 2), dtype=np.float64))


def times(curve: Array, checkpoints: list[float]) -> Array:
    """When a curve (T,) first reaches each share of its peak, as parts of T counted from 0, (checkpoints,)."""
    reached = curve >= np.asarray(checkpoints)[:, None] * curve.max()
    return np.asarray(reached.argmax(axis=1) / len(curve))


def score(pred: Array, gt: Array, settings: Settings) -> float:
    """DPA of two curves of total damage, (T,) and (T',); NaN if one has NaN."""
    if np.isnan(pred).any() or np.isnan(gt).any():
        return float("nan")
    none = [curve.max() < settings.least_damage for curve in (pred, gt)]
    if any(none) and not settings.strict:
        return float(all(none))
    apart = times(pred, settings.checkpoints) - times(gt, settings.checkpoints)
    return float(np.exp(-((apart / settings.sigma) ** 2)).mean())


def resampled(curve: Array) -> Array:
    """A curve (T,) at POINTS equal steps from its first to its last frame, (POINTS,)."""
    return np.interp(np.linspace(0, len(curve) - 1, POINTS), np.arange(len(curve)), curve)
