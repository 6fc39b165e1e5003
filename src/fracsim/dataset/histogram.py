"""Histograms as lines of text, for a page that is read as it is."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

BAR = 40
"""Columns of the longest bar."""
FEW = 16
"""Up to this many different values get a line each; more are put into bins."""
BINS = 10


def histogram(values: Sequence[Any]) -> list[str]:
    """A line for each value, or for each of BINS equal intervals of many numbers: the value, a bar, the count."""
    counts = Counter(values)
    if len(counts) > FEW and all(isinstance(value, (int, float)) for value in counts):
        counts = _binned(values)
        return _lines(list(counts), counts)
    return _lines(sorted(counts, key=lambda value: (isinstance(value, str), value)), counts)


def _binned(values: Sequence[float]) -> Counter[Any]:
    """Counts of equal intervals, named by their ends, with those that are empty."""
    low, width = min(values), (max(values) - min(values)) / BINS
    names = [f"{low + k * width:.4g} to {low + (k + 1) * width:.4g}" for k in range(BINS)]
    counts: Counter[Any] = Counter(dict.fromkeys(names, 0))
    counts.update(names[min(int((value - low) / width), BINS - 1)] for value in values)
    return counts


def _lines(names: Sequence[Any], counts: Counter[Any]) -> list[str]:
    texts = [f"{name:g}" if isinstance(name, float) else str(name) for name in names]
    wide, most = max(map(len, texts), default=0), max(counts.values(), default=1)
    bars = ("#" * -(-BAR * counts[name] // most) for name in names)
    return [f"{text:>{wide}}  {bar:<{BAR}}  {counts[name]}" for text, bar, name in zip(texts, bars, names, strict=True)]
