"""KVD: the unbiased discrepancy on sets that are small enough to write out."""

from itertools import combinations

import numpy as np
import pytest

from fracgen.metrics import kvd
from fracgen.metrics.kvd import mmd
from tests.metrics.feature_clips import pair

RNG = np.random.default_rng(0)
X, Y = RNG.normal(size=(7, 3)), RNG.normal(size=(7, 3)) + 0.5


def test_two_pairs_of_one_feature_written_out() -> None:
    """k(0, 1) + k(2, 3) - k(0, 3) - k(1, 2) = 1 + 343 - 1 - 27, with k(u, v) = (u v + 1)^3."""
    assert mmd(np.array([[0.0], [1]]), np.array([[2.0], [3]])) == 316


def test_it_is_the_mean_over_different_pairs() -> None:
    def kernel(u: np.ndarray, v: np.ndarray) -> float:  # type: ignore[type-arg]
        return float((u @ v / 3 + 1) ** 3)

    terms = [
        kernel(X[i], X[j]) + kernel(Y[i], Y[j]) - kernel(X[i], Y[j]) - kernel(X[j], Y[i])
        for i in range(7)
        for j in range(7)
        if i != j
    ]
    assert mmd(X, Y) == pytest.approx(np.mean(terms), rel=1e-12)


def test_it_has_no_bias_that_depends_on_n() -> None:
    """The mean over all choices of three of the pairs is the value of all."""
    parts = [mmd(X[list(some)], Y[list(some)]) for some in combinations(range(7), 3)]
    assert np.mean(parts) == pytest.approx(mmd(X, Y), rel=1e-12)


def test_equal_sets_are_at_zero() -> None:
    assert mmd(X, X.copy()) == 0


def test_a_pair_that_is_drawn_twice_is_not_compared_with_itself() -> None:
    """A bootstrap draws a pair several times: with three draws of two pairs only one comparison is left."""
    drawn = [0, 0, 1]
    assert mmd(X[drawn], Y[drawn]) == pytest.approx(mmd(X[:2], Y[:2]), rel=1e-12)
    assert np.isnan(mmd(X[[0, 0]], Y[[0, 0]]))


def test_a_generator_that_always_shows_one_clip_is_still_measured() -> None:
    """Its clips are equal, but their true clips are not, so that the pairs differ."""
    collapsed = np.repeat(X[:1], 7, axis=0)
    assert mmd(collapsed, Y) > 0


def test_sums_by_blocks_are_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = mmd(X, Y)
    monkeypatch.setattr(kvd, "BLOCK", 2)
    assert mmd(X, Y) == pytest.approx(whole, rel=1e-12)


def test_large_means_keep_what_differs() -> None:
    """Whole numbers are exact. Each of the four kernels, of about 1e18, is rounded to 2^-53 of it three times."""
    kernels = [(u * v + 1) ** 3 for u, v in ((1000, 1002), (1001, 1004), (1000, 1004), (1001, 1002))]
    found = mmd(np.array([[1000.0], [1002]]), np.array([[1001.0], [1004]]))
    assert found == pytest.approx(kernels[0] + kernels[1] - kernels[2] - kernels[3], abs=4 * 3 * 1.1e18 * 2**-53)


@pytest.mark.parametrize("n", [0, 1])
def test_fewer_than_two_clips_have_no_distance(n: int) -> None:
    assert np.isnan(mmd(X[:n], Y[:n]))


def test_results_carry_the_number_of_clips() -> None:
    m = kvd.build(kvd.Settings(extractor="random_conv3d", device="cpu"))
    for seed in range(3):
        m.update(pair(seed))
    results = m.compute()
    assert set(results) == {"kvd", "kvd_n", "kvd16", "kvd16_n"}
    assert results["kvd_n"] == 3
    assert results["kvd"] == results["kvd16"]  # 16 of 16 frames
