"""95 % intervals by resampling clips with replacement (Efron 1979), between percentiles of the resampled results."""

from collections.abc import Callable, Mapping

import numpy as np

from fracgen.evaluation.metric import Observation
from fracsim.records import Array

LEVEL = 0.95


def intervals(
    reduce: Callable[[Observation], Mapping[str, float]], observed: Mapping[str, Array], resamples: int, seed: int
) -> dict[str, tuple[float, float]]:
    """Low and high end for each result of observations (n, ...); none for a single clip, or without resamples.

    Resamples in which a result is undefined are left out. The clips are taken as independent of each other.
    """
    drawn = resampled(reduce, observed, resamples, seed)
    return {name: (low, high) for name, (low, high, _) in drawn.items()}


def spreads(
    reduce: Callable[[Observation], Mapping[str, float]], observed: Mapping[str, Array], resamples: int, seed: int
) -> dict[str, tuple[float, float]]:
    """As `intervals` of observations (n, ...), but moved so that their mean lies on the result of all clips.

    For distances between sets: a resample holds clips twice, which adds to a bias that falls with n.
    """
    drawn, values = resampled(reduce, observed, resamples, seed), reduce(observed)
    return {name: (values[name] + low - mean, values[name] + high - mean) for name, (low, high, mean) in drawn.items()}


def resampled(
    reduce: Callable[[Observation], Mapping[str, float]], observed: Mapping[str, Array], resamples: int, seed: int
) -> dict[str, tuple[float, float, float]]:
    """Both percentiles and the mean of each result over resamples of observations (n, ...)."""
    n = len(next(iter(observed.values()), ()))
    if n < 2 or resamples < 1:
        return {}
    rng, drawn = np.random.default_rng(seed), []
    for _ in range(resamples):
        chosen = rng.integers(0, n, n)
        drawn.append(reduce({name: values[chosen] for name, values in observed.items()}))
    names = dict.fromkeys(name for results in drawn for name in results)
    return {name: found for name in names if (found := _between([r.get(name, np.nan) for r in drawn])) is not None}


def _between(values: list[float]) -> tuple[float, float, float] | None:
    """The two percentiles of what is finite, and its mean; None when nothing is."""
    finite = np.array([value for value in values if np.isfinite(value)])
    if not finite.size:
        return None
    low, high = np.percentile(finite, (50 * (1 - LEVEL), 50 * (1 + LEVEL)))
    return float(low), float(high), float(finite.mean())
