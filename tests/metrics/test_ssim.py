"""SSIM in closed form, and against torchmetrics in float64."""

import numpy as np
import pytest
import torch
from torchmetrics.functional.image import structural_similarity_index_measure

from fracgen.metrics import ssim
from fracsim.records import Array
from tests.metrics.pixel_clips import grey, noise, pair

DIGITS = 1e-9
"""Variances are differences of numbers near 1, over C2 = 9e-4: 2e-16 / 9e-4 = 2e-13, with room for the sums."""


def score(pred: Array, true: Array) -> float:
    return ssim.build(ssim.Settings()).observe(pair(pred, true))["ssim"]


@pytest.mark.parametrize("video", [noise(0), grey(179, 255)])
def test_equal_clips_score_exactly_1(video: Array) -> None:
    """Flat ones too, whose variance is nothing but rounding."""
    assert score(video, video) == 1


def test_of_flat_pictures_only_the_luminance_is_left() -> None:
    a, b = 100 / 255, 160 / 255
    assert score(grey(100), grey(160)) == pytest.approx((2 * a * b + 1e-4) / (a * a + b * b + 1e-4), abs=DIGITS)


def test_it_is_that_of_torchmetrics_a_picture_at_a_time() -> None:
    true = noise(0)
    pred = np.clip(true + np.random.default_rng(1).normal(0, 25, true.shape), 0, 255).astype(np.uint8)
    tensors = [torch.from_numpy(video / 255).permute(0, 3, 1, 2) for video in (pred, true)]
    theirs = structural_similarity_index_measure(*tensors, data_range=1.0, reduction="none")
    metric = ssim.build(ssim.Settings())
    assert metric.scores(pred, true) == pytest.approx(theirs.numpy(), abs=DIGITS)


def test_frames_in_a_wrong_order_are_seen_and_those_in_any_common_order_are_alike() -> None:
    """As volumes, the frames beside a frame would matter: reversed in time, the score would be another one."""
    a, b = noise(0, frames=12, size=16), noise(1, frames=12, size=16)
    mixed = np.random.default_rng(2).permutation(12)
    assert score(a[mixed], b[mixed]) == pytest.approx(score(a, b), abs=DIGITS)
    assert score(a[::-1], a) < 0.5


def test_the_picture_that_a_generator_was_shown_is_left_out_of_gen() -> None:
    found = ssim.build(ssim.Settings()).observe(pair(grey(0, 100), grey(0, 160)))
    assert found["ssim_gen"] == pytest.approx(score(grey(100), grey(160)), abs=DIGITS)
    assert found["ssim"] == pytest.approx((1 + found["ssim_gen"]) / 2, abs=DIGITS)


def test_it_is_symmetric_and_falls_with_noise() -> None:
    """Noise of independent pixels has no structure in common."""
    true = grey(128)
    scores = []
    for levels in (5, 20, 60):
        pred = (true + np.random.default_rng(0).integers(-levels, levels + 1, true.shape)).astype(np.uint8)
        assert score(pred, true) == pytest.approx(score(true, pred), abs=DIGITS)
        scores.append(score(pred, true))
    assert scores == sorted(scores, reverse=True)
    assert abs(score(noise(0), noise(1))) < 0.1
