"""KVD: the squared maximum mean discrepancy of video features, with the cubic kernel of KID, unbiased in n.

The features are those of FVD. Unlike FVD it has no bias that depends on n, so that it suits a few dozens of clips; it
can be negative. Its kernel is that of Binkowski et al. (2018), arXiv:1801.01401.
"""

from dataclasses import dataclass

import numpy as np

from fracgen.metrics._features import FeatureDistance, FeatureSettings
from fracsim.records import Array
from fracsim.scene.knob import check

SECTION = "metric.kvd"
BLOCK = 1024
"""Rows of the matrix of kernels that are held at once."""


@dataclass(kw_only=True)
class Settings(FeatureSettings):
    """What KVD is measured with."""

    def __post_init__(self) -> None:
        check(self, SECTION)


class Kvd(FeatureDistance):
    """The distance of all frames, kvd, and of a strided shorter clip, kvd16."""

    title = "kvd"

    def distance(self, x: Array, y: Array) -> float:
        """The squared discrepancy of features (n, D)."""
        return mmd(x, y)


def build(settings: Settings) -> Kvd:
    """The metric; raises MissingWeightsError without weights, ValueError for what cannot be used."""
    return Kvd(settings, SECTION)


def mmd(x: Array, y: Array) -> float:
    """The unbiased squared MMD of paired features x, y (n, D): Gretton et al. (2012), equation 4.

    The mean over pairs i != j of k(xi, xj) + k(yi, yj) - k(xi, yj) - k(xj, yi), with k(u, v) = (u . v / D + 1)^3. The
    cross terms leave out i = j too: a predicted clip is no independent draw from its own true clip. A pair that occurs
    several times, as in a resample of a bootstrap, is one pair with a weight, never compared with itself. NaN for fewer
    than two different pairs.
    """
    x, y, weight = distinct(x, y)
    pairs = weight.sum() ** 2 - weight @ weight
    if not pairs:
        return float("nan")
    total = 0.0
    for begin in range(0, len(x), BLOCK):
        rows = slice(begin, begin + BLOCK)
        h = _kernel(x[rows], x) + _kernel(y[rows], y) - 2 * _kernel(x[rows], y)
        np.fill_diagonal(h[:, begin:], 0)
        total += weight[rows] @ h @ weight
    return float(total / pairs)


def _kernel(x: Array, y: Array) -> Array:
    """The cubic kernel of each row of x (n, D) with each of y (m, D), (n, m)."""
    k = x @ y.T
    k /= x.shape[1]
    k += 1
    return k * k * k  # type: ignore[no-any-return]


def distinct(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Pairs (n, D) without repeats, and how often each occurs, (n,) float64."""
    first: dict[bytes, int] = {}
    inverse = [first.setdefault(a.tobytes() + b.tobytes(), k) for k, (a, b) in enumerate(zip(x, y, strict=True))]
    counts = np.bincount(inverse, minlength=len(x)) if len(x) else np.zeros(0)
    once = np.flatnonzero(counts)
    return x[once], y[once], counts[once].astype(np.float64)
