"""Constitutive consistency R2_cons: how well one elastic law, stress = k strain, explains the maps of intact material.

With the slope fitted, R2 = (sum eps sigma)^2 / (sum eps^2 sum sigma^2): the squared cosine between stress and strain,
not centred. Two independent fields that are uniform in [0, 1] score 9/16 = 0.5625, so that is the level of chance, not
0. Each map may have a scale of its own, but values that were cut off at the top change it.
"""

from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from fracgen.evaluation.clip import Clip, Pair
from fracgen.evaluation.grey import DEADBAND, background, deadband, floor, grey
from fracgen.evaluation.metric import Metric, Observation, mean
from fracgen.layout import DAMAGE, STRAIN, STRESS
from fracsim.records import Array
from fracsim.scene.knob import check, knob

CHANCE = 9 / 16
"""R2 of two independent fields that are uniform in [0, 1]: E[x]^4 / E[x^2]^2."""


@dataclass(kw_only=True)
class Settings:
    """Which pixels are intact material."""

    d_max: float = knob(0.05, "material with more damage is left out", least=0, most=1)
    deadband: float = knob(DEADBAND, "where strain, stress and damage, less the background's medians, are all below "
                           "this there is no object; 0 = all pixels count, with damage as it is", "levels of 255",
                           least=0, most=255)  # fmt: skip

    def __post_init__(self) -> None:
        check(self, "metric.r2_cons")


def build(settings: Settings) -> "R2Cons":
    """The metric."""
    return R2Cons(settings)


class R2Cons(Metric):
    """R2_cons of the prediction, and of the true maps as its ceiling."""

    needs = (STRAIN, STRESS, DAMAGE)
    columns = ("r2_cons", "r2_gt", "r2_intact_pred", "r2_intact_gt", "r2_sums_pred", "r2_sums_gt")
    """R2 of both clips; parts of the pixels that are intact material; sums of eps sigma, eps^2 and sigma^2 over them,
    (3,) each."""
    shown = ("r2_cons", "r2_gt", "r2_intact_pred", "r2_intact_gt")
    higher = MappingProxyType({"r2_cons": True, "r2_pooled": True})

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        self.settings = settings

    def observe(self, pair: Pair) -> dict[str, Any]:
        """R2 of both clips, the true one NaN if there is none; each is masked by its own damage."""
        outside = background(pair.gt or pair.pred)
        seen: dict[str, Any] = {}
        for who, clip in (("pred", pair.pred), ("gt", pair.gt)):
            sums, intact = (np.full(3, np.nan), np.nan) if clip is None else self._sums(clip, outside)
            seen |= {f"r2_sums_{who}": sums, f"r2_intact_{who}": intact}
        return {"r2_cons": r2(seen["r2_sums_pred"]), "r2_gt": r2(seen["r2_sums_gt"]), **seen}

    def reduce(self, observed: Observation) -> dict[str, float]:
        """Means over clips, R2 of the pixels of all clips together, and how many clips are undefined."""
        return {
            **{name: mean(observed[name]) for name in self.shown},
            "r2_pooled": r2(np.nansum(observed["r2_sums_pred"], axis=0)),
            "r2_gt_pooled": r2(np.nansum(observed["r2_sums_gt"], axis=0)),
            "r2_undefined": int(np.isnan(observed["r2_cons"]).sum()),
        }

    def about(self) -> dict[str, Any]:
        """All settings, and the level of chance."""
        return {**asdict(self.settings), "chance": CHANCE}

    def _sums(self, clip: Clip, outside: Array) -> tuple[Array, float]:
        """Sums over the intact material of a clip, and which part of its pixels that is."""
        levels = self.settings.deadband
        strain, stress, raw = (grey(clip.map(name)) for name in (STRAIN, STRESS, DAMAGE))
        damage = deadband(raw, outside, levels)
        least = [floor(values, outside) + levels / 255 if levels else 0.0 for values in (strain, stress)]
        totals, count = np.zeros(3), 0
        for eps, sigma, d in zip(strain, stress, damage, strict=True):
            material = (eps >= least[0]) | (sigma >= least[1]) | (d > 0)
            intact = material & (d <= self.settings.d_max)
            totals += sums(eps[intact], sigma[intact])
            count += int(intact.sum())
        return totals, count / strain.size


def sums(eps: Array, sigma: Array) -> Array:
    """The sums of eps sigma, eps^2 and sigma^2 over n pixels, eps and sigma (n,), as (3,) float64."""
    eps, sigma = eps.astype(np.float64), sigma.astype(np.float64)
    return np.array([eps @ sigma, eps @ eps, sigma @ sigma])


def r2(totals: Array) -> float:
    """R2 of the sums (3,) of eps sigma, eps^2 and sigma^2; NaN without strain or without stress."""
    mixed, strain, stress = (float(total) for total in totals)
    return mixed**2 / (strain * stress) if strain > 0 and stress > 0 else float("nan")
