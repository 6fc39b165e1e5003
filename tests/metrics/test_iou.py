"""Overlaps of boxes in closed form."""

import math

import numpy as np
import pytest

from fracgen.evaluation.clip import Clip, LackingError, Pair
from fracgen.metrics import iou
from fracsim.records import Array
from tests.metrics.pixel_clips import boxes, clip, grey, noise, painted

A, B, FAR = boxes((8, 24, 4, 12)), boxes((8, 24, 8, 16)), boxes((8, 24, 20, 28))
"""Boxes of 8 columns. The first two share 4 of 12 columns, the last one shares none with them."""


def video(*masks: Array) -> Array:
    """A video (T, 32, 32, 3) of a brown object on white."""
    return np.stack([painted(mask) for mask in masks])


def covered(*masks: Array) -> Clip:
    """A clip of alpha and of noise in its colours."""
    return clip(rgb=noise(0, frames=len(masks)), alpha=np.stack(masks).astype(np.float32))


def observe(pred: Clip, true: Clip, by: str = "auto") -> dict[str, float]:
    return iou.build(iou.Settings(by=by)).observe(Pair(pred, true))


@pytest.mark.parametrize("make", [covered, lambda *masks: clip(rgb=video(*masks))])
def test_shifted_boxes_overlap_by_a_third(make: type[Clip]) -> None:
    found = observe(make(A, A), make(B, B))
    for name in ("iou_spatial", "iou_spatiotemporal", "iou_weighted"):
        assert found[name] == pytest.approx(1 / 3)


def test_equal_clips_overlap_wholly_and_others_not_at_all() -> None:
    names = ("iou_spatial", "iou_spatiotemporal", "iou_weighted")
    same, apart = observe(covered(A, B), covered(A, B)), observe(covered(A, A), covered(FAR, FAR))
    assert [same[name] for name in names] == [1, 1, 1]
    assert [apart[name] for name in names] == [0, 0, 0]


def test_a_clip_played_backwards_is_right_in_space_and_wrong_in_time() -> None:
    found = observe(covered(A, FAR), covered(FAR, A))
    assert (found["iou_spatial"], found["iou_spatiotemporal"], found["iou_weighted"]) == (1, 0, 1)


def test_the_weighted_overlap_knows_how_long() -> None:
    """A place taken in one frame of four instead of three: (1 + 1) / (3 + 3) where A and FAR are complementary."""
    found = observe(covered(A, FAR, FAR, FAR), covered(A, A, A, FAR))
    assert found["iou_spatial"] == 1
    assert found["iou_weighted"] == pytest.approx(2 / 6)
    assert found["iou_spatiotemporal"] == pytest.approx(2 / 4)


def test_frames_without_an_object_in_either_clip_are_undefined() -> None:
    none = boxes()
    assert observe(covered(A, none), covered(A, none))["iou_spatiotemporal"] == 1
    assert observe(covered(A, A), covered(A, none))["iou_spatiotemporal"] == 0.5
    assert math.isnan(observe(covered(none), covered(none))["iou_spatial"])


def test_masks_come_from_the_same_source_in_both_clips() -> None:
    """The true clip's alpha, of A, is not used beside a clip without one: its colours say B."""
    true = clip(rgb=video(B), alpha=A[None].astype(np.float32))
    pred = clip(rgb=video(B))
    assert observe(pred, true)["iou_spatial"] == 1
    assert observe(pred, true)["by_alpha"] == 0
    assert observe(true, true)["by_alpha"] == 1
    assert observe(true, clip(rgb=video(A)), by="colour")["iou_spatial"] == pytest.approx(1 / 3)
    with pytest.raises(LackingError, match="has no alpha"):
        observe(pred, true, by="alpha")


def test_scores_do_not_depend_on_resolution() -> None:
    large = [covered(*(np.kron(mask, np.ones((3, 3), bool)) for mask in masks)) for masks in ((A, B), (B, FAR))]
    large = [clip(rgb=np.zeros((2, 96, 96, 3), np.uint8), alpha=one.alpha) for one in large]
    small = [clip(rgb=np.zeros((2, 32, 32, 3), np.uint8), alpha=one.alpha) for one in (covered(A, B), covered(B, FAR))]
    assert observe(*large) == pytest.approx(observe(*small))


def test_the_error_of_colour_is_that_of_the_clip() -> None:
    found = observe(clip(rgb=grey(0, 0)), clip(rgb=grey(51, 102)))
    assert found["mse_rgb"] == pytest.approx((0.2**2 + 0.4**2) / 2)
    assert math.isnan(observe(clip(alpha=np.ones((1, 4, 4))), clip(alpha=np.ones((1, 4, 4))))["mse_rgb"])
