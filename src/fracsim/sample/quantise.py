"""Physical values to 16 bits and back, so that exactly zero stays exactly zero.

A range has equal steps. So a single wild value would take the digits of all others: values far beyond the others are
outliers, which are stored as they are. Half-precision codes need none, but cost every value more than the first five
bits of its error (`tests/sample/test_quantise.py`).
"""

from typing import NamedTuple

import numpy as np

from fracsim.records import Array

LEVELS = 65535
WILD = 16.0
"""A value is an outlier that is more than this many times as large as ..."""
SHARE = 20
"""... all but one in SHARE of the values that are not zero."""


def quantise(raw: Array) -> tuple[Array, tuple[float, float]]:
    """Values of any shape as uint16 codes and the range (lo, hi) they span; zero gets a code of its own.

    The error is at most half a step of (hi - lo) / LEVELS, and float32 rounding; an array that nowhere reaches 1e-30
    is taken as zero. Raises ValueError when a value is not finite.
    """
    least, most = min(float(raw.min()), 0.0), max(float(raw.max()), 0.0)
    if not np.isfinite(most - least):
        raise ValueError(f"{np.count_nonzero(~np.isfinite(raw))} of {raw.size} values are not finite")
    # One level is given up so that zero can be moved onto a code without losing an end of the range.
    step = (most - least) / (LEVELS - 1)
    if step < 1e-35:  # its inverse would overflow float32
        return np.zeros(raw.shape, np.uint16), (0.0, 0.0)
    zero = np.ceil(-least / step)
    codes = raw * np.float32(1 / step) + np.float32(zero + 0.5)  # the cast cuts off, so this rounds; 0 <= codes < 65536
    return codes.astype(np.uint16), (-zero * step, (LEVELS - zero) * step)


def dequantise(codes: Array, lo: float, hi: float) -> Array:
    """float32 values lo + codes / LEVELS * (hi - lo) of codes of any shape; the code of zero gives exactly 0."""
    if hi <= lo:
        return np.zeros(codes.shape, np.float32)
    step = (hi - lo) / LEVELS
    values = codes.astype(np.float32)
    values -= np.float32(round(-lo / step))  # exact, for both are whole numbers below 2^24
    values *= np.float32(step)
    return values


class Coded(NamedTuple):
    """The channels of a map of one frame."""

    codes: Array
    """[C, H, W] uint16; at outliers, that of the nearest value within the range."""
    ranges: list[tuple[float, float]]
    """lo and hi of each channel."""
    outliers: list[tuple[int, int, int, float]]
    """Channel, row, column and value of each outlier."""


def encode(planes: Array) -> Coded:
    """The channels of a map, [C, H, W] float32, as codes; raises ValueError when a value is not finite."""
    codes, ranges, outliers = np.empty(planes.shape, np.uint16), [], []
    for c, plane in enumerate(planes):
        tame, wild = split(plane)
        codes[c], span = quantise(tame)
        ranges.append(span)
        outliers += [(c, int(row), int(column), float(plane[row, column])) for row, column in np.argwhere(wild)]
    return Coded(codes, ranges, outliers)


def split(raw: Array) -> tuple[Array, Array]:
    """`raw` with outliers moved to the nearest value that is none, or 0; and which they are, bool.

    Both have the shape of `raw`, any shape. Values that are not finite are left as they are.
    """
    size = np.abs(raw)
    most, nothing = float(size.max()), np.zeros(raw.shape, bool)
    some = max(np.count_nonzero(raw) // SHARE, 1)
    if not np.isfinite(most) or np.count_nonzero(size >= most / WILD) > some:  # the common case, decided fast
        return raw, nothing
    values = size[size > 0]
    usual = float(np.partition(values, -some - 1)[-some - 1]) if len(values) > some else 0.0
    wild = size > WILD * usual
    kept = raw[~wild]
    return np.clip(raw, min(kept.min(initial=0), 0), max(kept.max(initial=0), 0)), wild
