"""16-bit codes: what is lost is at most half a step, and zero is not touched."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fracsim.sample.quantise import LEVELS, dequantise, quantise

# Beyond 1e-30 the step is a normal float32; maps of that size or less are zero in every respect.
SIZES = st.floats(1e-30, 1e30) | st.just(0.0)


@given(SIZES, SIZES, st.integers(0, 2**32 - 1))
def test_half_a_step_is_lost_and_zero_is_exact(low: float, high: float, seed: int) -> None:
    raw = np.random.default_rng(seed).uniform(-low, high, 500).astype(np.float32)
    raw[::7] = 0
    codes, (lo, hi) = quantise(raw)
    back = dequantise(codes, lo, hi)
    assert codes.dtype == np.uint16
    assert back.dtype == np.float32
    assert (back[raw == 0] == 0).all()
    # Half a step, and the rounding of codes up to 2^16 in float32: 2^-8 of a step each way.
    assert np.abs(back.astype(float) - raw).max() <= 0.51 * (hi - lo) / LEVELS + 1e-30


def test_stored_range_gives_the_values_back() -> None:
    # What a reader in another language does: value = lo + q / 65535 (hi - lo).
    raw = np.linspace(-0.7, 1.9, 1000, dtype=np.float32)
    codes, (lo, hi) = quantise(raw)
    np.testing.assert_allclose(lo + codes / LEVELS * (hi - lo), raw, atol=0.51 * (hi - lo) / LEVELS)
    assert lo <= raw.min()
    assert hi >= raw.max()


def test_positive_maps_use_the_whole_range() -> None:
    codes, (lo, hi) = quantise(np.array([0.0, 0.5, 1.0], np.float32))
    assert lo == 0
    assert codes.max() >= LEVELS - 1
    assert hi == pytest.approx(1, rel=1e-4)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="1 of 4 values are not finite"):
        quantise(np.array([0, 1, bad, 2], np.float32))
