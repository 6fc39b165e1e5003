"""FVD: the Frechet distance in closed form, and what makes up the result."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf

from fracgen.evaluation.clip import LackingError, Pair
from fracgen.features._video import strided
from fracgen.metrics import fvd, kvd
from fracgen.metrics.fvd import extrapolated, frechet
from tests.metrics.feature_clips import clip, counting, gaussian, pair, video

CONF = Path(__file__).parents[2] / "conf" / "metric"
EPS = np.finfo(np.float64).eps


def metric(**given: object) -> fvd.Fvd:
    return fvd.build(fvd.Settings(**{"extractor": "random_conv3d", "device": "cpu", **given}))  # type: ignore[arg-type]


@pytest.mark.parametrize("module", [fvd, kvd])
def test_the_defaults_are_those_of_the_configuration(module: object) -> None:
    """conf/metric has a file for each metric."""
    name = module.__name__.rpartition(".")[2]  # type: ignore[attr-defined]
    assert OmegaConf.to_container(OmegaConf.load(CONF / f"{name}.yaml")) == asdict(module.Settings())  # type: ignore[attr-defined]


def test_a_shift_of_the_mean_counts_squared() -> None:
    root = np.diag([1.0, 2.0, 3.0])
    x, y = gaussian(np.zeros(3), root, 9), gaussian(np.array([1.0, 2, 2]), root, 9)
    assert frechet(x, y) == pytest.approx(9, abs=1e-13)


def test_scaled_axes_count_the_squared_difference_of_deviations() -> None:
    a, b = np.array([1.0, 2, 3]), np.array([2.0, 2, 0.5])
    x, y = gaussian(np.zeros(3), np.diag(a), 9), gaussian(np.zeros(3), np.diag(b), 12)
    assert frechet(x, y) == pytest.approx(((a - b) ** 2).sum(), abs=1e-13)


@settings(max_examples=30)
@given(st.lists(st.floats(-3, 3), min_size=8, max_size=8))
def test_covariances_of_different_axes_follow_the_formula_for_two_features(values: list[float]) -> None:
    """tr (S1 S2)^(1/2) = (tr S1 S2 + 2 (det S1 det S2)^(1/2))^(1/2) in two dimensions."""
    a, b = np.array(values).reshape(2, 2, 2)
    sa, sb = a.T @ a, b.T @ b
    areas = (a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]) * (b[0, 0] * b[1, 1] - b[0, 1] * b[1, 0])
    cross = np.sqrt(np.trace(sa @ sb) + 2 * abs(areas))
    expected = np.trace(sa) + np.trace(sb) - 2 * cross
    found = frechet(gaussian(np.zeros(2), a, 5), gaussian(np.zeros(2), b, 5))
    assert found == pytest.approx(expected, abs=1e-6)  # the formula's outer root loses half of the digits near 0


def test_fewer_clips_than_features_are_a_plain_case() -> None:
    """Covariances of rank 2 and 1 in 6 dimensions; the product of the covariances has rank 1."""
    x = gaussian(np.zeros(6), np.eye(6)[:2] * 3, 4)
    y = gaussian(np.zeros(6), np.eye(6)[:1], 4)
    assert frechet(x, y) == pytest.approx((3 - 1) ** 2 + 3**2, abs=1e-13)


@pytest.mark.parametrize("n", [16, 100, 900])
def test_the_distance_of_a_set_to_itself_is_round_off(n: int) -> None:
    """400 features; an error of eps in each of as many terms, of traces of about 400."""
    x = np.random.default_rng(0).normal(size=(n, 400))
    assert abs(frechet(x, x)) < 400 * 400 * EPS


@pytest.mark.parametrize("n", [20, 60])
def test_large_means_cancel(n: int) -> None:
    """The centred values lose the digits that 1000 takes: 1e3 eps each, in a distance of 400 features."""
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(n, 40)), rng.normal(size=(n, 40)) * 2
    assert frechet(x + 1000, y + 1000) == pytest.approx(frechet(x, y), rel=1e4 * EPS)


def test_clips_and_true_clips_count_alike() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(30, 20)), rng.normal(size=(50, 20)) + 1
    assert frechet(x, y) == pytest.approx(frechet(y, x), rel=1e-12)


@pytest.mark.parametrize("n", [0, 1])
def test_fewer_than_two_clips_have_no_distance(n: int) -> None:
    assert np.isnan(frechet(np.zeros((n, 3)), np.zeros((n, 3))))


def test_extrapolation_removes_the_bias_of_few_clips() -> None:
    """Independent sets of one law, whose true distance is 0: what is left is the noise of the mean of 20 repeats."""
    sets = [np.random.default_rng(seed).normal(size=(2, 200, 5)) for seed in range(20)]
    left, plain = ([measure(x, y) for x, y in sets] for measure in (extrapolated, frechet))
    assert abs(np.mean(left)) < 4 * np.std(left) / np.sqrt(20)
    assert np.mean(plain) > 8 * np.std(left) / np.sqrt(20)


def test_fewer_than_four_clips_are_not_extrapolated() -> None:
    assert np.isnan(extrapolated(np.eye(3), np.zeros((3, 3))))


def test_a_shorter_clip_has_a_constant_stride() -> None:
    assert strided(81, 16).tolist() == list(range(0, 80, 5))  # type: ignore[union-attr]
    assert strided(21, 16).tolist() == list(range(16))  # type: ignore[union-attr]
    assert strided(31, 16).tolist() == list(range(0, 31, 2))  # type: ignore[union-attr]
    assert strided(15, 16) is None


def test_results_carry_the_number_of_clips() -> None:
    m = metric()
    for seed in range(3):
        m.update(pair(seed, frames=17))
    results = m.compute()
    assert set(results) == {"fvd", "fvd_n", "fvd16", "fvd16_n"}
    assert results["fvd_n"] == results["fvd16_n"] == 3
    assert results["fvd"] > 0
    assert results["fvd"] != results["fvd16"]
    assert m.about()["network"].startswith("random")


def test_the_results_are_the_distance_of_what_the_network_says() -> None:
    m = metric(short=0)
    pairs = [pair(seed) for seed in range(4)]
    for p in pairs:
        m.update(p)
    x, y = (
        np.stack([m.reader.network(c.rgb) for c in clips])
        for clips in zip(*((p.pred, p.true) for p in pairs), strict=True)
    )
    assert m.compute() == {"fvd": frechet(x, y), "fvd_n": 4}


def test_clips_of_fewer_than_16_frames_have_no_fvd16() -> None:
    m = metric()
    for seed in range(3):
        m.update(pair(seed, frames=10))
    results = m.compute()
    assert results["fvd"] > 0
    assert np.isnan(results["fvd16"])
    assert (results["fvd_n"], results["fvd16_n"]) == (3, 0)


def test_extrapolation_is_another_result() -> None:
    m = metric(short=0, extrapolate=True)
    for seed in range(4):
        m.update(pair(seed))
    assert set(m.compute()) == {"fvd", "fvd_n", "fvd_inf"}


def test_clips_whose_features_are_undefined_are_left_out_and_not_counted(tmp_path: Path) -> None:
    m = metric(extractor=counting(tmp_path), keep=False)
    for seed in range(3):
        m.update(pair(seed))
    without = m.compute()
    m.update(Pair(clip("black", np.zeros((16, 8, 8, 3), np.uint8)), clip("gt", video(7))))
    assert m.compute() == without
    assert without["fvd_n"] == 3


def test_too_short_clips_and_clips_without_truth_are_refused(tmp_path: Path) -> None:
    m = metric(extractor=counting(tmp_path), keep=False)
    with pytest.raises(LackingError, match="pred has 1 frames; means needs 2"):
        m.observe(pair(0, frames=1))
    with pytest.raises(LackingError, match="no true clip"):
        m.observe(Pair(clip("pred", video(0)), None))


def test_bad_settings_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"metric\.fvd\.short=1 is not allowed: .* at least 2 frames"):
        metric(extractor=counting(tmp_path), short=1)
    with pytest.raises(ValueError, match=r"metric\.fvd\.extractor=i3d_whel is not known: .*i3d_wheel"):
        metric(extractor="i3d_whel")
    with pytest.raises(ValueError, match=r"metric\.fvd\.weights=a\.pt: random_conv3d has no weights"):
        metric(weights="a.pt")
    with pytest.raises(ValueError, match=r"metric\.kvd\.device=tpu"):
        kvd.Settings(device="tpu")
