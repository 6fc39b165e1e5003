"""16-bit codes: what is lost is at most half a step, zero is not touched, and wild values take no digits of others."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fracsim.sample.quantise import LEVELS, SHARE, WILD, Coded, dequantise, encode, quantise

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


def decoded(coded: Coded) -> np.ndarray:
    """What a reader makes of it, [C, H, W]."""
    values = np.stack([dequantise(codes, *span) for codes, span in zip(coded.codes, coded.ranges, strict=True)])
    for c, row, column, value in coded.outliers:
        values[c, row, column] = value
    return values


def field(seed: int) -> np.ndarray:
    """Up to 1 kPa on half of a plane, [1, 64, 64]."""
    rng = np.random.default_rng(seed)
    raw = (1e3 * rng.random((1, 64, 64))).astype(np.float32)
    raw[:, 40:] = 0
    return raw


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("pixels", [1, 30])
def test_a_wild_value_is_exact_and_takes_no_digits_of_the_others(sign: int, pixels: int) -> None:
    """1e9 Pa beside 1 kPa: the error of the others is half a step of a range of 1 kPa, 8 mPa; it was 15 kPa."""
    raw, at = field(1), (0, np.arange(pixels), np.arange(pixels))
    raw[at] = sign * 1e9 * (1 + np.arange(pixels, dtype=np.float32) / 7)
    coded = encode(raw)
    back = decoded(coded)
    assert (back[at] == raw[at]).all()
    assert sorted(coded.outliers) == [(0, k, k, float(raw[0, k, k])) for k in range(pixels)]
    rest = np.ones(raw.shape, bool)
    rest[at] = False
    assert np.abs(back.astype(float) - raw)[rest].max() <= 0.51 * 1e3 / LEVELS
    assert (back[raw == 0] == 0).all()
    # A reader that knows no outliers sees the end of the range there.
    end = dequantise(coded.codes[0], *coded.ranges[0])[at[1:]]
    np.testing.assert_allclose(end, 1e3 if sign > 0 else 0, atol=1)


def test_planes_without_outliers_are_coded_as_before() -> None:
    raw = field(2)
    raw[0, 0, 0] = 0.99 * WILD * np.quantile(raw[raw > 0], 1 - 1 / SHARE)
    coded = encode(raw)
    codes, span = quantise(raw)
    assert (coded.codes[0] == codes).all()
    assert coded.ranges == [span]
    assert coded.outliers == []


@given(st.integers(0, 2**32 - 1), st.floats(0, 12))
def test_the_error_is_bounded_by_what_most_values_are(seed: int, decades: float) -> None:
    """Values over any number of decades: half a step of a range of twice WILD times the 95th percentile."""
    rng = np.random.default_rng(seed)
    raw = (rng.choice([-1, 1], (2, 20, 20)) * 10 ** rng.uniform(-decades, 0, (2, 20, 20))).astype(np.float32)
    raw[rng.random(raw.shape) < 0.3] = 0
    coded = encode(raw)
    back = decoded(coded)
    assert (back[raw == 0] == 0).all()
    for c in range(2):
        size = np.sort(np.abs(raw[c][raw[c] != 0]))[::-1]
        usual = float(size[len(size) // SHARE])
        assert np.abs(back[c].astype(float) - raw[c]).max() <= 0.51 * 2 * WILD * usual / LEVELS
    assert len(coded.outliers) <= (raw != 0).sum() // SHARE + 2


@pytest.mark.parametrize("raw", [[[0.0]], [[5.0]], [[0.0, 3e8]], [[1e-3, 3e8]], [[0.0, 0.0]], [[-2.0, 0.0, 1e30]]])
def test_planes_of_few_pixels_come_back(raw: list[list[float]]) -> None:
    plane = np.array([raw], np.float32)
    np.testing.assert_allclose(decoded(encode(plane)), plane, rtol=1e-5)


def test_half_precision_would_cost_usual_values_five_bits() -> None:
    """Why codes have equal steps: against float16, scaled to its range, they are 30 times as exact at the upper end."""
    raw = field(3)
    half = (raw / raw.max() * 65504).astype(np.float16).astype(float) / 65504 * raw.max()
    error = np.abs(decoded(encode(raw)).astype(float) - raw).max()
    assert np.abs(half - raw).max() > 30 * error
