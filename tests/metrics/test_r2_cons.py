"""R2_cons on maps whose law is known."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

import fracgen
from fracgen.evaluation.clip import Clip
from fracgen.metrics import r2_cons
from fracsim.records import Array
from tests.metrics.films import clip, pair

CONF = Path(fracgen.__file__).parents[2] / "conf/metric/r2_cons.yaml"
SHAPE = (4, 64, 64, 1)
RNG = np.random.default_rng(0)
EPS = RNG.uniform(0.1, 1, SHAPE)
NOISE = RNG.uniform(0.1, 1, SHAPE)


def film(strain: Array, stress: Array, damage: Array | float = 0.0) -> Clip:
    """A clip of maps alone."""
    frames, height, width, _ = strain.shape
    maps = {"strain": strain, "stress": stress, "damage": np.broadcast_to(damage, strain.shape)}
    return clip(frames=frames, size=(height, width), **{name: np.float32(values) for name, values in maps.items()})


def on_black(values: Array) -> Array:
    """Maps (T, H, W, C) in a picture of four times the area that is black elsewhere, object in the middle."""
    _, height, width, _ = values.shape
    return np.pad(values, [(0, 0), (height // 2,) * 2, (width // 2,) * 2, (0, 0)])


def observe(pred: Clip, gt: Clip | None = None, **settings: object) -> dict[str, float]:
    return r2_cons.build(r2_cons.Settings(**settings)).observe(pair(pred, gt))


def test_the_yaml_file_has_the_defaults() -> None:
    assert r2_cons.Settings(**OmegaConf.to_container(OmegaConf.load(CONF))) == r2_cons.Settings()


@pytest.mark.parametrize("k", [0.3, 1.0])
def test_a_linear_law_scores_one_whatever_its_slope(k: float) -> None:
    # Sums of float32 maps: their relative error of 6e-8 enters squared.
    assert observe(film(on_black(EPS), on_black(k * EPS)))["r2_cons"] == pytest.approx(1, abs=1e-12)


def test_it_is_one_minus_the_part_of_stress_that_a_slope_leaves() -> None:
    eps, sigma = np.float32(EPS).ravel().astype(float), np.float32(NOISE).ravel().astype(float)
    k = (eps @ sigma) / (eps @ eps)
    fitted = 1 - ((sigma - k * eps) ** 2).sum() / (sigma**2).sum()
    cosine = (eps @ sigma) / np.linalg.norm(eps) / np.linalg.norm(sigma)
    found = observe(film(EPS, NOISE), deadband=0.0)["r2_cons"]
    assert found == pytest.approx(fitted, abs=1e-12)
    assert found == pytest.approx(cosine**2, abs=1e-12)


def test_independent_fields_score_nine_sixteenths() -> None:
    # R2 = m11^2 / (m20 m02) of n samples; its standard deviation is at most 2 sqrt(var(xy) / n) / 0.25 + ...: with
    # n = 10^6 below 1e-3; four of them.
    rng = np.random.default_rng(1)
    a, b = rng.random((2, 1, 1000, 1000, 1))
    assert observe(film(a, b), deadband=0.0)["r2_cons"] == pytest.approx(r2_cons.CHANCE, abs=4e-3)


def test_stress_at_right_angles_to_strain_scores_zero() -> None:
    strain, stress = np.zeros((2, *SHAPE))
    strain[:, :32], stress[:, 32:] = 1, 1
    assert observe(film(on_black(strain), on_black(stress)))["r2_cons"] == 0


def test_a_scale_for_each_map_is_harmless_and_a_cut_at_the_top_is_not() -> None:
    # Strain x uniform in [0, 1], stress min(x, c): E[x stress] = c^3/3 + c (1 - c^2)/2, E[stress^2] = c^3/3 +
    # c^2 (1 - c). Of n equal steps the sums are off by 1 / n^2.
    strain = ((np.arange(4096) + 0.5) / 4096).reshape(1, 64, 64, 1)
    assert observe(film(strain, 0.5 * strain), deadband=0.0)["r2_cons"] == pytest.approx(1, abs=1e-12)
    cut = 0.5
    mixed, square = cut**3 / 3 + cut * (1 - cut**2) / 2, cut**3 / 3 + cut**2 * (1 - cut)
    found = observe(film(strain, np.minimum(strain, cut)), deadband=0.0)["r2_cons"]
    assert found == pytest.approx(mixed**2 / (square / 3), abs=1e-6)
    assert found < 0.95


def test_black_background_changes_nothing() -> None:
    inside, framed = observe(film(EPS, NOISE), deadband=0.0), observe(film(on_black(EPS), on_black(NOISE)))
    assert framed["r2_cons"] == pytest.approx(inside["r2_cons"], abs=1e-12)
    assert framed["r2_intact_pred"] == pytest.approx(inside["r2_intact_pred"] / 4)
    unmasked = observe(film(on_black(EPS), on_black(NOISE)), deadband=0.0)
    assert unmasked["r2_cons"] == pytest.approx(framed["r2_cons"], abs=1e-12)


@pytest.mark.parametrize("floor", [3 / 255, 10 / 255])
def test_the_floor_of_a_decoded_background_counts_only_where_it_is_not_masked(floor: float) -> None:
    # Weak fields at right angles: score 0, were it not for a background on which both are `floor`.
    weak = on_black(np.ones(SHAPE))
    left, right = 0.15 * weak, 0.15 * weak
    left[:, :, 64:], right[:, :, :64] = 0, 0
    decoded = [values + floor * (weak == 0) for values in (left, right)]
    masked = observe(film(*decoded))["r2_cons"]
    assert masked == 0
    assert observe(film(*decoded), deadband=0.0)["r2_cons"] > 1e-4


def test_only_material_that_has_not_failed_counts() -> None:
    damage = np.zeros(SHAPE)
    damage[:, :, :32] = 0.06
    damage[:, :, 32:] = 0.05 - 1e-4
    stress = np.where(damage > 0.05, NOISE, 0.5 * EPS)
    maps = [on_black(values) for values in (EPS, stress, damage)]
    seen = observe(film(*maps))
    assert seen["r2_cons"] == pytest.approx(1, abs=1e-12)
    assert seen["r2_intact_pred"] == pytest.approx(1 / 8)
    assert observe(film(*maps), d_max=0.1)["r2_cons"] < 0.99


def test_each_clip_is_masked_by_its_own_damage() -> None:
    stress = NOISE.copy()
    stress[:, :, 32:] = EPS[:, :, 32:]
    damage = np.zeros(SHAPE)
    damage[:, :, :32] = 1
    said = film(*[on_black(values) for values in (EPS, stress, damage)])
    unsaid = film(on_black(EPS), on_black(stress))
    seen = observe(said, unsaid)
    assert seen["r2_cons"] == pytest.approx(1, abs=1e-12)
    assert seen["r2_gt"] < 0.99


def test_three_channels_are_one_map() -> None:
    one = observe(film(on_black(EPS), on_black(NOISE)))
    three = observe(film(*[np.repeat(on_black(values), 3, axis=-1) for values in (EPS, NOISE)]))
    assert three["r2_cons"] == pytest.approx(one["r2_cons"], rel=1e-6)


@pytest.mark.parametrize(
    "maps",
    [(EPS, EPS, 1.0), (EPS, 0 * EPS, 0.0), (0 * EPS, EPS, 0.0), (0 * EPS, 0 * EPS, 0.0)],
    ids=["all failed", "no stress", "no strain", "nothing"],
)  # fmt: skip
def test_without_intact_material_or_energy_it_is_undefined(maps: tuple[Array, Array, float]) -> None:
    assert np.isnan(observe(film(*maps), deadband=0.0)["r2_cons"])


def test_results_are_means_pooled_values_and_counts() -> None:
    m = r2_cons.build(r2_cons.Settings(deadband=0.0))
    law, chance, none = film(EPS, EPS), film(EPS, NOISE), film(0 * EPS, 0 * EPS)
    for pred in (law, chance, none):
        m.update(pair(pred, law))
    result = m.compute()
    low = observe(chance, deadband=0.0)
    sums = np.sum([r2_cons.sums(EPS.ravel(), EPS.ravel()), low["r2_sums_pred"]], axis=0)
    assert result["r2_cons"] == pytest.approx((1 + low["r2_cons"]) / 2)
    assert result["r2_pooled"] == pytest.approx(sums[0] ** 2 / sums[1] / sums[2], rel=1e-6)
    assert result["r2_gt"] == result["r2_gt_pooled"] == pytest.approx(1)
    assert result["r2_undefined"] == 1
    assert m.about()["chance"] == 0.5625


def test_a_true_clip_is_not_needed() -> None:
    seen = observe(film(on_black(EPS), on_black(EPS)))
    assert seen["r2_cons"] == pytest.approx(1)
    assert np.isnan(seen["r2_gt"])
