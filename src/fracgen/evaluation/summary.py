"""Results of observations: overall and by group, with n, what is undefined, and intervals."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fracgen.evaluation.bootstrap import intervals, spreads
from fracgen.evaluation.metric import Metric
from fracgen.evaluation.pairing import Couple
from fracsim.records import Array

Rows = Sequence[tuple[Couple, Mapping[str, Any]]]


def stack(metric: Metric, rows: Rows) -> dict[str, Array]:
    """The observations of n couples as arrays (n, ...); raises ValueError when their shapes differ."""
    stacked = {}
    for name in metric.columns:
        values = [np.asarray(observation[name], np.float64) for _, observation in rows]
        shapes = dict.fromkeys(value.shape for value in values)
        if len(shapes) > 1:
            raise ValueError(f"{name} has different shapes: {', '.join(map(str, shapes))}; score clips of equal "
                             "numbers of frames together")  # fmt: skip
        stacked[name] = np.stack(values)
    return stacked


def results(metric: Metric, rows: Rows, resamples: int, seed: int) -> dict[str, Any]:
    """What `rows` say: n, undefined counts, and each result with its interval. Raises ValueError as `stack` does."""
    observed = stack(metric, rows)
    values = metric.reduce(observed)
    between = spreads if metric.of_sets else intervals
    ends = between(metric.reduce, observed, resamples, seed)
    undefined = {name: int(np.isnan(observed[name]).sum()) for name in metric.shown}
    return {
        "n": len(rows),
        "undefined": {name: count for name, count in undefined.items() if count},
        "results": {name: _result(value, ends.get(name)) for name, value in values.items()},
    }


def _result(value: float, ends: tuple[float, float] | None) -> dict[str, float | None]:
    """A result and its interval; null where it is undefined."""
    counted = isinstance(value, int)  # a number of clips
    low, high = ends if ends is not None and np.isfinite(value) and not counted else (None, None)
    return {"value": value if counted else float(value) if np.isfinite(value) else None, "low": low, "high": high}


def by_group(metric: Metric, rows: Rows, name: str, resamples: int, seed: int) -> dict[str, Any]:
    """Results for each value of a group, sorted; couples that do not know it are left out."""
    values = {couple.groups[name] for couple, _ in rows if name in couple.groups}
    ordered = sorted(values, key=lambda value: (isinstance(value, str), value))
    return {shown(value): results(metric, [row for row in rows if row[0].groups.get(name) == value], resamples, seed)
            for value in ordered}  # fmt: skip


def shown(value: Any) -> str:
    """The value of a group, for people."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def whole(metric: Metric, rows: Rows, by: Sequence[str], resamples: int, seed: int) -> dict[str, Any]:
    """The entry of a metric in metrics.json."""
    resamples = min(resamples, metric.resamples)
    groups = {name: by_group(metric, rows, name, resamples, seed) for name in by}
    return {
        "about": metric.about(),
        "higher": dict(metric.higher),
        **results(metric, rows, resamples, seed),
        "by": {name: found for name, found in groups.items() if found},
    }
