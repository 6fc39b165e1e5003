"""DPA on curves of damage that are known."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

import fracgen
from fracgen.evaluation.clip import Clip
from fracgen.metrics import dpa
from fracsim.records import Array
from tests.metrics.films import clip, pair

CONF = Path(fracgen.__file__).parents[2] / "conf/metric/dpa.yaml"
MASK = np.zeros((16, 16), bool)
MASK[4:12, 4:12] = True
"""An object on a quarter of the picture."""


def film(curve: Array, channels: int = 1, floor: float = 0.0) -> Clip:
    """A clip whose object has the damage curve (T,), over a background of `floor`."""
    damage = np.where(MASK[..., None], np.asarray(curve)[:, None, None, None], 0) + floor
    alpha = np.broadcast_to(MASK, (len(curve), 16, 16)).astype(np.float32)
    return clip(frames=len(curve), size=(16, 16), damage=np.repeat(damage, channels, axis=-1).astype(np.float32),
                alpha=alpha)  # fmt: skip


def score(pred: Array, gt: Array, **settings: object) -> float:
    return dpa.score(np.asarray(pred, float), np.asarray(gt, float), dpa.Settings(**settings))


def step(at: int, frames: int) -> Array:
    return (np.arange(frames) >= at).astype(float)


def test_the_yaml_file_has_the_defaults() -> None:
    assert dpa.Settings(**OmegaConf.to_container(OmegaConf.load(CONF))) == dpa.Settings()


def test_a_clip_against_itself_scores_one() -> None:
    clip = film(np.linspace(0, 1, 21))
    assert dpa.build(dpa.Settings()).observe(pair(clip, clip))["dpa"] == 1


@pytest.mark.parametrize("shift", [1, 4, 8, 16])
def test_a_shifted_curve_scores_the_kernel_of_its_shift(shift: int) -> None:
    ramp = np.clip((np.arange(80) - 20) / 40, 0, 1)
    late = np.clip((np.arange(80) - 20 - shift) / 40, 0, 1)
    assert score(late, ramp) == pytest.approx(np.exp(-((shift / 80 / 0.1) ** 2)))
    assert score(ramp, late) == pytest.approx(np.exp(-((shift / 80 / 0.1) ** 2)))


def test_a_checkpoint_is_reached_when_damage_equals_it() -> None:
    # Damage t / 10: the share 0.5 is met in frame 5 of 11, counted from 0.
    ramp = np.arange(11) / 10
    assert dpa.times(ramp, [0.5, 1.0]) == pytest.approx([5 / 11, 10 / 11])


def test_the_first_crossing_counts_also_when_damage_falls_again() -> None:
    curve = np.array([0, 0.6, 0.1, 0.1, 1.0])
    assert dpa.times(curve, [0.5, 0.9]) == pytest.approx([1 / 5, 4 / 5])


def test_each_clip_has_its_own_length_and_peak() -> None:
    # The same moment of clips of 20 and 40 frames; the peak of one is a tenth of the other's.
    assert score(step(10, 20), 0.1 * step(20, 40)) == 1
    assert score(step(10, 20), step(10, 40)) == pytest.approx(np.exp(-((0.25 / 0.1) ** 2)))


def test_a_different_shape_is_a_mean_over_checkpoints() -> None:
    # The prediction is at its peak in frame 0; the ramp reaches 0.1, ..., 0.9 in frames 1, ..., 9 of 10 + 1.
    ramp = np.arange(11) / 10
    expected = np.mean([np.exp(-((k / 11 / 0.1) ** 2)) for k in range(1, 10)])
    assert score(np.ones(11), ramp) == pytest.approx(expected)


def test_clips_without_damage_agree_with_each_other_only() -> None:
    none, torn = 5e-4 * step(3, 21), step(10, 21)
    assert score(none, 0 * none) == 1
    assert score(none, torn) == score(torn, none) == 0
    assert score(1e-3 * step(10, 21), torn) == 1


def test_strict_is_the_formula_also_without_damage() -> None:
    # Nothing but zeros reaches each share of its peak, 0, in frame 0.
    torn = step(1, 20)
    assert score(np.zeros(20), torn, strict=True) == pytest.approx(np.exp(-((0.05 / 0.1) ** 2)))
    assert score(5e-4 * torn, torn, strict=True) == 1


@pytest.mark.parametrize("channels", [1, 3])
def test_the_floor_of_a_decoded_map_is_taken_off_both_clips(channels: int) -> None:
    # A VAE that leaves 3 of 255 everywhere, and flickers by 2 more, would let a late tear begin in frame 0.
    curve = 0.08 * step(15, 21)
    flicker = np.random.default_rng(0).random((21, 16, 16, 1)).astype(np.float32) * 2 / 255
    decoded = film(curve, channels, floor=3 / 255)
    decoded = clip(frames=21, size=(16, 16), damage=decoded.get("damage") + flicker, alpha=decoded.alpha)
    true = film(curve, channels)
    seen = dpa.build(dpa.Settings()).observe(pair(decoded, true))
    assert seen["dpa"] == 1
    raw = dpa.build(dpa.Settings(deadband=0.0)).observe(pair(decoded, true))
    assert raw["dpa"] < 0.7
    # Flicker remains on the object, at most 1 of 255 about the median, on a quarter of the picture.
    assert seen["dpa_peak_pred"] == pytest.approx(seen["dpa_peak_gt"], abs=0.25 / 255 + 1e-6)
    assert seen["dpa_peak_gt"] == pytest.approx(0.02)


def test_curves_are_kept_at_equal_steps_of_any_clip() -> None:
    m = dpa.build(dpa.Settings())
    for frames in (21, 81):
        m.update(pair(film(np.linspace(0, 1, frames)), film(np.linspace(0, 0.5, frames))))
    (a, b), (c, _) = m.dpa_curve_pred, m.dpa_curve_gt
    np.testing.assert_allclose(a[0], np.linspace(0, 0.25, dpa.POINTS), atol=0.25 * 4 / 255)
    np.testing.assert_allclose(b[0], a[0], atol=0.25 * 4 / 255)
    np.testing.assert_allclose(c[0], a[0] / 2, atol=0.25 * 4 / 255)
    assert m.compute()["dpa"] == 1


def test_results_count_clips_without_damage() -> None:
    m = dpa.build(dpa.Settings())
    still, torn = film(np.zeros(21)), film(step(10, 21))
    for pred, gt in ((still, still), (still, torn), (torn, torn)):
        m.update(pair(pred, gt))
    result = m.compute()
    assert result["dpa"] == pytest.approx(2 / 3)
    assert (result["dpa_undamaged_pred"], result["dpa_undamaged_gt"]) == (2, 1)
    assert m.about()["least_damage"] == 1e-3


def test_damage_that_is_no_number_has_no_score() -> None:
    curve = step(10, 21)
    broken = film(curve)
    broken.get("damage")[3, 0, 0] = np.nan
    assert np.isnan(dpa.build(dpa.Settings(deadband=0.0)).observe(pair(broken, film(curve)))["dpa"])


def test_no_checkpoints_are_refused() -> None:
    with pytest.raises(ValueError, match=r"metric\.dpa\.checkpoints"):
        dpa.Settings(checkpoints=[])
