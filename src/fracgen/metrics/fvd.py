"""FVD: the Frechet distance between Gaussians fitted to video features of predicted and of true clips.

Unterthiner et al. (2018), arXiv:1812.01717. It depends on the number of clips: an FVD of few clips is mostly bias, so
that only those of equal n compare.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from fracgen.metrics._features import FeatureDistance, FeatureSettings
from fracsim.records import Array
from fracsim.scene.knob import check, knob

SECTION = "metric.fvd"
SPLITS = 4
"""Divisions of the clips into halves, over which an extrapolation averages."""


@dataclass(kw_only=True)
class Settings(FeatureSettings):
    """What FVD is measured with."""

    extrapolate: bool = knob(False, "also fvd_inf, extrapolated in 1/n from all clips and halves of them; to be used "
                             "with several times as many clips as features")  # fmt: skip

    def __post_init__(self) -> None:
        check(self, SECTION)


class Fvd(FeatureDistance):
    """The distance of all frames, fvd, and of a strided shorter clip, fvd16."""

    title = "fvd"
    of_sets = True

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, SECTION)
        self.extrapolate = settings.extrapolate

    def distance(self, x: Array, y: Array) -> float:
        """The Frechet distance of features (n, D)."""
        return frechet(x, y)

    def reduce(self, observed: dict[str, Array]) -> dict[str, float]:  # type: ignore[override]
        """fvd and fvd16 with the numbers of clips, and fvd_inf if asked for; observations are (n, D)."""
        results = super().reduce(observed)
        if self.extrapolate:
            results["fvd_inf"] = extrapolated(*self.defined(observed["pred"], observed["gt"]))
        return results


def build(settings: Settings) -> Fvd:
    """The metric; raises MissingWeightsError without weights, ValueError for what cannot be used."""
    return Fvd(settings)


def frechet(x: Array, y: Array) -> float:
    """The squared Frechet distance of Gaussians with the means and covariances, over n - 1, of x (n, D) and y (m, D).

    |mean x - mean y|^2 + tr(Sx) + tr(Sy) - 2 tr((Sx Sy)^(1/2)). With centred factors, Sx = A^T A and Sy = B^T B, the
    last trace is the sum of the singular values of A B^T. No covariance is formed and no root of one, which is complex
    or negative when there are fewer clips than features. NaN for fewer than two clips.
    """
    if min(len(x), len(y)) < 2:
        return float("nan")
    shift = x.mean(0, dtype=np.float64) - y.mean(0, dtype=np.float64)
    a, b = _factor(x), _factor(y)
    nuclear = linalg.svd(a @ b.T, compute_uv=False, check_finite=False).sum()
    return float(shift @ shift + np.vdot(a, a) + np.vdot(b, b) - 2 * nuclear)


def _factor(x: Array) -> Array:
    """A (min(n, D), D) with A^T A the covariance of x (n, D)."""
    centred: Array = np.asarray(x, np.float64)
    centred = (centred - centred.mean(0)) / float(np.sqrt(len(x) - 1))
    if len(x) <= x.shape[1]:
        return centred
    R: Array = linalg.qr(centred, mode="r", overwrite_a=True, check_finite=False)[0]
    return R[: x.shape[1]]


def extrapolated(x: Array, y: Array, splits: int = SPLITS) -> float:
    """The Frechet distance of paired features (n, D) for n to infinity, if its bias falls as 1/n: 2 FD(n) - FD(n/2).

    FD(n/2) is the mean over both halves of some divisions of the pairs (after Chong and Forsyth 2020,
    arXiv:1911.07023). NaN for fewer than four clips.
    """
    if len(x) < 4:
        return float("nan")
    halves, random = [], np.random.default_rng(0)
    for _ in range(splits):
        order = random.permutation(len(x))
        halves += [frechet(x[part], y[part]) for part in np.array_split(order, 2)]
    return 2 * frechet(x, y) - float(np.mean(halves))
