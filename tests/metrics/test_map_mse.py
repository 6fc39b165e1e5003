"""Errors of maps in closed form, of flat maps and of flow whose vectors are known."""

import math

import numpy as np
import pytest

from fracgen.evaluation.clip import Clip, LackingError, Pair
from fracgen.evaluation.foreground import COVERED
from fracgen.metrics import map_mse
from fracsim import codec
from fracsim.records import Array
from tests.metrics.pixel_clips import boxes, clip

ROUNDING = 1e-6
"""Relative; maps are float32, sums are float64."""
LEFT, TOP = boxes((0, 8, 0, 4), size=8), boxes((0, 4, 0, 8), size=8)
"""Halves of a picture of 8 x 8 px; together three quarters of it."""


def observe(pred: Clip, true: Clip, **settings: list[str]) -> dict[str, float]:
    return map_mse.build(map_mse.Settings(**settings)).observe(Pair(pred, true))


def flat(value: float, where: Array | None = None, frames: int = 2) -> Array:
    """A scalar map of one value, or of this value on a mask (8, 8) and 0 elsewhere, (T, 8, 8, 1) float32."""
    picture = np.where(np.ones((8, 8), bool) if where is None else where, value, 0)
    return np.broadcast_to(picture[..., None], (frames, 8, 8, 1)).astype(np.float32)


def flowing(right: float, up: float, scale: float = 1.0) -> Array:
    """Flow of one velocity everywhere as it is shown, (2, 8, 8, 3)."""
    return codec.encode(np.full((2, 8, 8, 2), (right, up), np.float32), scale)


def test_a_flat_error_is_squared_and_the_overall_error_is_the_mean_of_the_maps() -> None:
    levels = {"strain": 0.1, "stress": 0.2, "damage": 0.4}
    found = observe(clip(**{name: flat(0.5 + error) for name, error in levels.items()}),
                    clip(**dict.fromkeys(levels, flat(0.5))))  # fmt: skip
    assert {name: found[f"mse_{name}"] for name in levels} == pytest.approx(
        {name: error**2 for name, error in levels.items()}, rel=ROUNDING)  # fmt: skip
    assert found["mse"] == pytest.approx((0.01 + 0.04 + 0.16) / 3, rel=ROUNDING)
    assert found["maps"] == 3


def test_the_background_counts_and_the_foreground_error_leaves_it_out() -> None:
    """A map of 0.5 on half of the picture, seen as 0.2: 0.09 there, 0.045 in all."""
    found = observe(clip(stress=flat(0.2, LEFT)), clip(stress=flat(0.5, LEFT)))
    assert found["mse_stress"] == pytest.approx(0.045, rel=ROUNDING)
    assert found["mse_fg_stress"] == pytest.approx(0.09, rel=ROUNDING)


def test_foreground_is_where_either_clip_has_something() -> None:
    """Maps of 0.5 on the left and on the top half: an error of 0.25 on two quarters, of three that are foreground."""
    found = observe(clip(stress=flat(0.5, LEFT)), clip(stress=flat(0.5, TOP)))
    assert found["mse_fg_stress"] == pytest.approx(0.25 * 2 / 3, rel=ROUNDING)
    assert found["mse_fg"] == found["mse_fg_stress"]


def test_alpha_is_the_foreground_of_a_clip_that_has_one() -> None:
    """The true clip covers the top half; the predicted one has no alpha, and its map lies on the left half."""
    alpha = np.broadcast_to(np.where(TOP, COVERED + 0.01, COVERED), (2, 8, 8)).astype(np.float32)
    found = observe(clip(stress=flat(0.5, LEFT)), clip(stress=flat(0.0), alpha=alpha))
    assert found["mse_fg_stress"] == pytest.approx(0.25 * 2 / 3, rel=ROUNDING)


def test_what_a_vae_paints_for_black_is_no_foreground() -> None:
    floor = flat(map_mse.DEADBAND)
    assert math.isnan(observe(clip(stress=floor), clip(stress=flat(0.0)))["mse_fg_stress"])
    assert observe(clip(stress=floor), clip(stress=flat(0.0)))["mse_stress"] > 0


def test_colour_is_a_mean_over_three_channels() -> None:
    """Flow to the right is pure red, so that an error of magnitude is one in one channel of three."""
    found = observe(clip(flow=flowing(0.3, 0)), clip(flow=flowing(0.9, 0)))
    assert found["mse_flow"] == pytest.approx(0.36 / 3, rel=ROUNDING)
    assert found["mse_flow_speed"] == pytest.approx(0.36, rel=ROUNDING)


def test_a_turned_flow_has_no_error_of_speed() -> None:
    """(0.5, 0) and (0, 0.5) differ by 0.5 sqrt(2). Decoding inverts the wheel up to float32: 1e-6 of a turn."""
    found = observe(clip(flow=flowing(0.5, 0)), clip(flow=flowing(0, 0.5)))
    assert found["mse_flow_speed"] == pytest.approx(0, abs=1e-12)
    assert found["mse_flow"] > 0.05
    assert found["epe_flow"] == pytest.approx(0.5 * math.sqrt(2), rel=1e-5)
    assert math.isnan(found["epe_flow_m_s"])


def test_end_points_are_in_metres_a_second_where_both_scales_are_known() -> None:
    """3 m/s of 6, against 3 m/s of 4, both to the left: 0.25 of a scale, and nothing in truth."""
    found = observe(clip({"flow": 6.0}, flow=flowing(-3, 0, 6)), clip({"flow": 4.0}, flow=flowing(-3, 0, 4)))
    assert found["epe_flow"] == pytest.approx(0.25, rel=1e-5)
    assert found["epe_flow_m_s"] == pytest.approx(0, abs=1e-5)


def test_a_wrong_amplitude_is_seen_with_scales_alone() -> None:
    """The same picture, at twice the stress: an error of 0.5 in units of the true scale."""
    pred, true = clip({"stress": 2e4}, stress=flat(0.5)), clip({"stress": 1e4}, stress=flat(0.5))
    assert observe(pred, true)["mse_stress"] == 0
    assert observe(pred, true)["mse_scaled_stress"] == pytest.approx(0.25, rel=ROUNDING)
    assert math.isnan(observe(pred, clip(stress=flat(0.5)))["mse_scaled_stress"])
    assert math.isnan(observe(clip(stress=flat(0.5)), true)["mse_scaled_stress"])


def test_a_grey_map_may_be_given_in_three_equal_channels() -> None:
    found = observe(clip(damage=flat(0.8).repeat(3, axis=-1)), clip(damage=flat(0.5)))
    assert found["mse_damage"] == pytest.approx(0.09, rel=ROUNDING)


def test_a_map_that_one_clip_lacks_is_undefined_and_not_in_the_mean() -> None:
    found = observe(clip(stress=flat(0.5), damage=flat(0.1)), clip(stress=flat(0.4)))
    assert math.isnan(found["mse_damage"])
    assert found["mse"] == found["mse_stress"]
    assert found["maps"] == 1


def test_only_wanted_maps_are_compared_and_named() -> None:
    maps = {"stress": flat(0.5), "damage": flat(0.1)}
    found = observe(clip(**maps), clip(stress=flat(0.1), damage=flat(0.3)), maps=["damage"])
    assert list(found) == ["mse", "mse_fg", "mse_damage", "mse_fg_damage", "maps"]
    assert found["mse"] == pytest.approx(0.04, rel=ROUNDING)


def test_clips_that_share_no_map_are_refused() -> None:
    with pytest.raises(LackingError, match="share no map of flow, strain, stress, damage"):
        observe(clip(stress=flat(0.5)), clip(damage=flat(0.5)))


def test_undefined_values_are_not_in_the_mean_over_clips() -> None:
    metric = map_mse.build(map_mse.Settings(maps=["stress", "damage"]))
    metric.update(Pair(clip(stress=flat(0.5)), clip(stress=flat(0.1))))
    metric.update(Pair(clip(damage=flat(0.5)), clip(damage=flat(0.2))))
    found = metric.compute()
    assert (found["mse_stress"], found["mse_damage"]) == pytest.approx((0.16, 0.09), rel=ROUNDING)
    assert found["mse"] == pytest.approx(0.125, rel=ROUNDING)
    assert math.isnan(found["mse_scaled_stress"])


@pytest.mark.parametrize("maps", [[], ["heat"], ["stress", "stress"]])
def test_other_maps_are_refused(maps: list[str]) -> None:
    with pytest.raises(ValueError, match=r"metric\.map_mse\.maps"):
        map_mse.Settings(maps=maps)
