"""The object in a picture without alpha: exact on pictures whose mask is known."""

import numpy as np
import pytest

from fracgen.evaluation.foreground import foreground, mask
from tests.metrics.pixel_clips import boxes, clip, painted

BODY = (8, 24, 6, 26)
"""16 x 20 pixels."""


def test_the_object_on_a_white_background_is_found_exactly() -> None:
    assert np.array_equal(foreground(painted(boxes(BODY))), boxes(BODY))


@pytest.mark.parametrize("background", [0, 90, 200])
def test_any_plain_background_will_do(background: int) -> None:
    assert np.array_equal(foreground(painted(boxes(BODY), background=background)), boxes(BODY))


def test_an_object_that_touches_the_border_does_not_become_the_background() -> None:
    """Most of the border is background, and the median asks no more."""
    whole = (8, 24, 0, 32)
    assert np.array_equal(foreground(painted(boxes(whole))), boxes(whole))


def test_both_halves_of_a_torn_object_stay_and_a_speck_goes() -> None:
    left, right, speck = (8, 24, 2, 12), (8, 24, 20, 26), (0, 2, 0, 2)
    assert np.array_equal(foreground(painted(boxes(left, right, speck))), boxes(left, right))


def test_a_highlight_is_filled_and_the_hole_of_a_ring_is_not() -> None:
    """A hole of one pixel is less than a hundredth of the object, one of 4 x 4 is more."""
    ring = boxes(BODY) & ~boxes((14, 18, 14, 18))
    assert np.array_equal(foreground(painted(ring & ~boxes((10, 11, 10, 11)))), ring)


def test_noise_of_a_codec_is_background() -> None:
    """Levels within 6 of the background's, where 20 are asked for."""
    noise = np.random.default_rng(0).integers(-6, 7, (32, 32, 3))
    picture = np.clip(painted(boxes(BODY)).astype(int) + noise, 0, 255).astype(np.uint8)
    assert np.array_equal(foreground(picture), boxes(BODY))


def test_a_rough_background_raises_what_counts_as_far() -> None:
    """Noise of +-30 levels: the larger distance of three channels has the median 30 * 0.5^(1/3) = 24, so that 72 are
    far; black is 98 away at least. The border's 124 pixels give the median to a few levels.
    """
    noise = np.random.default_rng(0).integers(-30, 31, (32, 32, 3))
    picture = np.clip(painted(boxes(BODY), (0, 0, 0), background=128).astype(int) + noise, 0, 255).astype(np.uint8)
    assert np.array_equal(foreground(picture), boxes(BODY))


def test_a_picture_of_one_colour_has_no_object() -> None:
    assert not foreground(painted(boxes())).any()


def test_alpha_wins_over_colour_and_half_covered_is_background() -> None:
    alpha = np.where(boxes(BODY), 0.5, 0).astype(np.float32)
    alpha[10:12, 10:12] = 0.51
    both = clip(rgb=painted(boxes(BODY))[None], alpha=alpha[None])
    assert np.array_equal(mask(both, 0), boxes((10, 12, 10, 12)))
    assert np.array_equal(mask(clip(rgb=painted(boxes(BODY))[None]), 0), boxes(BODY))
