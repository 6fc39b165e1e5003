"""Physical values to 16 bits and back, so that exactly zero stays exactly zero."""

import numpy as np

from fracsim.records import Array

LEVELS = 65535


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
