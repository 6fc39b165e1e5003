"""PSNR in closed form, of flat frames whose error is known."""

import math

import numpy as np
import pytest

from fracgen.evaluation.clip import LackingError, Pair
from fracgen.metrics import psnr
from tests.metrics.pixel_clips import clip, grey, noise, pair

DIGITS = 1e-9
"""Of sums in float64, of a few operations each."""


def metric(**settings: float) -> psnr.Psnr:
    return psnr.build(psnr.Settings(**settings))


def ratio(levels: float) -> float:
    """Of a flat error of so many of 255 levels [dB]."""
    return 20 * math.log10(255 / levels)


def test_a_flat_error_has_its_closed_form() -> None:
    found = metric().observe(pair(grey(100, 100), grey(117, 117)))
    assert found == pytest.approx(dict.fromkeys(("psnr", "psnr_gen", "psnr_clip"), ratio(17)), abs=DIGITS)


def test_equal_frames_count_as_the_cap_and_never_as_infinite() -> None:
    same = noise(0)
    assert metric().observe(pair(same, same)) == {"psnr": 100, "psnr_gen": 100, "psnr_clip": 100}
    assert metric(cap=60).observe(pair(same, same))["psnr"] == pytest.approx(60, abs=DIGITS)


def test_the_mean_of_frames_is_not_the_ratio_of_the_pooled_error() -> None:
    """Errors of 1 and of 51 levels: 48.1 and 14.0 dB have the mean 31.1; the pooled error has 17.0 dB."""
    found = metric().observe(pair(grey(0, 0), grey(1, 51)))
    assert found["psnr"] == pytest.approx((ratio(1) + ratio(51)) / 2, abs=DIGITS)
    assert found["psnr_clip"] == pytest.approx(ratio(math.sqrt((1 + 51**2) / 2)), abs=DIGITS)


def test_the_picture_that_a_generator_was_shown_is_left_out_of_gen() -> None:
    found = metric().observe(pair(grey(7, 0, 0), grey(7, 5, 50)))
    assert found["psnr"] == pytest.approx((100 + ratio(5) + ratio(50)) / 3, abs=DIGITS)
    assert found["psnr_gen"] == pytest.approx((ratio(5) + ratio(50)) / 2, abs=DIGITS)


def test_gen_of_one_picture_is_undefined() -> None:
    assert math.isnan(metric().observe(pair(grey(0), grey(9)))["psnr_gen"])


def test_bytes_do_not_wrap_around() -> None:
    """0 - 255 is the largest error, of 0 dB; as bytes it would be 1."""
    assert metric().observe(pair(grey(0), grey(255)))["psnr"] == pytest.approx(0, abs=DIGITS)
    assert metric().observe(pair(grey(255), grey(0)))["psnr"] == pytest.approx(0, abs=DIGITS)


def test_pixels_may_be_shuffled_alike() -> None:
    a, b = noise(0), noise(1)
    order = np.random.default_rng(2).permutation(32 * 32)
    mixed = (video.reshape(3, -1, 3)[:, order].reshape(video.shape) for video in (a, b))
    assert metric().observe(pair(*mixed)) == pytest.approx(metric().observe(pair(a, b)), abs=DIGITS)


@pytest.mark.filterwarnings("ignore:The ``compute`` method of metric")
def test_clips_count_alike_whatever_their_length() -> None:
    """As torchmetrics' objects it is updated, computed and reset."""
    m = metric()
    assert m.compute() == {}
    m.update(pair(grey(0), grey(10)))
    m.update(pair(grey(0, 0, 0), grey(20, 20, 20)))
    assert m.compute()["psnr"] == pytest.approx((ratio(10) + ratio(20)) / 2, abs=DIGITS)
    assert m.compute()["psnr_gen"] == pytest.approx(ratio(20), abs=DIGITS)
    m.reset()
    assert m.compute() == {}


def test_what_is_lacking_is_said() -> None:
    with pytest.raises(LackingError, match="has no rgb"):
        metric().observe(Pair(clip(stress=np.zeros((1, 8, 8, 1))), clip(rgb=grey(0))))
    with pytest.raises(LackingError, match="no true clip"):
        metric().observe(Pair(clip(rgb=grey(0)), None))


def test_a_cap_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match=r"metric\.psnr\.cap=0 is not allowed"):
        psnr.Settings(cap=0)
