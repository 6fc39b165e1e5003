"""The stretching axis of displacements, in closed form."""

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from fracgen.evaluation.axis import between, orientation, principal, similarity, stretching
from fracsim.records import Array
from tests.metrics.films import directions, disk, stretch

SEEN = np.ones(400, bool)
ROUND_OFF = 1e-9
"""Angles in degrees of double precision arithmetic on some hundred points."""


def axis_of(F: Array, drift: tuple[float, float] = (0, 0), tau: float = 0.1, k: int = 10):
    X = disk()
    return stretching(X, (X - (64, 64)) @ F.T + (64, 64) + drift, SEEN, tau, k)


@pytest.mark.parametrize("angle", [0.0, 1.0, 30.0, 45.0, 90.0, 135.0, 179.0])
def test_a_pull_along_a_line_has_that_axis_and_full_confidence(angle: float) -> None:
    found = axis_of(stretch(angle, 1.4))
    assert between(found.angle, angle) < ROUND_OFF
    assert found.confidence == pytest.approx(1, abs=1e-12)
    assert 0 <= found.angle < 180


def test_confidence_of_a_disk_that_contracts_across_is_that_of_elliptic_integrals() -> None:
    # u = (a x, -b y) on a ring: sum(w) = 4 a E(m), m = 1 - b^2 / a^2, and sum(u_x^2 / w) = a d/da of it. A sum over
    # equal steps of a smooth periodic function has no error beyond round-off.
    a, b = 0.4, 0.1
    u = directions(np.arange(2000) * 0.18) * (a, -b)
    m = 1 - b**2 / a**2
    Qxx = 1 + b**2 / a**2 * (ellipe(m) and (ellipe(m) - ellipk(m)) / (m * ellipe(m)))
    Q = orientation(u, np.linalg.norm(u, axis=1))
    assert Q[0, 0] == pytest.approx(Qxx, abs=1e-12)
    assert Q[0, 0] + Q[1, 1] == pytest.approx(1, abs=1e-12)
    assert principal(Q)[1] == pytest.approx(1 - (1 - Qxx) / Qxx, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_closed_form_is_that_of_an_eigensolver(seed: int) -> None:
    u = np.random.default_rng(seed).standard_normal((50, 2)) * (3, 1)
    Q = orientation(u, np.linalg.norm(u, axis=1))
    values, vectors = np.linalg.eigh(Q)
    angle, confidence = principal(Q)
    assert confidence == pytest.approx(1 - values[0] / values[1], abs=1e-12)
    assert between(angle, np.degrees(np.arctan2(-vectors[1, 1], vectors[0, 1])) % 180) < 1e-6


def test_an_even_expansion_has_no_axis_worth_its_name() -> None:
    # On a ring, Q = I / 2 exactly.
    u = directions(np.arange(360.0))
    assert principal(orientation(u, np.ones(360)))[1] == pytest.approx(0, abs=1e-12)


def test_scattered_motion_has_a_confidence_near_zero() -> None:
    # r is the length of a weighted mean of n random unit vectors: below 3 sqrt(<w^2> / <w>^2 / n) with a chance of
    # 1 - exp(-9) = 0.9999; of a Rayleigh distributed w that is 3 sqrt(4 / pi / n); c = 2 r / (1 + r) < 2 r.
    n = 4000
    X = np.zeros((n, 2))
    u = np.random.default_rng(1).standard_normal((n, 2))
    assert stretching(X, X + u, np.ones(n, bool), 0, 10).confidence < 6 * np.sqrt(4 / np.pi / n)


def test_drift_does_not_count() -> None:
    still, drifting = axis_of(stretch(30, 1.4)), axis_of(stretch(30, 1.4), drift=(20, -7))
    assert drifting.angle == pytest.approx(still.angle, abs=ROUND_OFF)
    assert drifting.confidence == pytest.approx(still.confidence, abs=1e-12)


def test_pushing_together_has_the_axis_of_pulling_apart() -> None:
    pull, push = axis_of(stretch(30, 1.3)), axis_of(stretch(30, 0.7))
    assert between(pull.angle, push.angle) < ROUND_OFF


def test_a_motion_that_is_larger_all_over_has_the_same_axis() -> None:
    small, large = axis_of(stretch(70, 1.2, 0.95), tau=0), axis_of(stretch(70, 1.4, 0.9), tau=0)
    assert small.angle == pytest.approx(large.angle, abs=ROUND_OFF)
    assert small.confidence == pytest.approx(large.confidence, abs=1e-12)


def test_points_are_dropped_before_they_are_counted() -> None:
    # 9 points move by 5 px, in pairs and one alone; 100 stand still, so that the mean moves by less than 0.05 px.
    X = np.zeros((109, 2))
    u = np.zeros((109, 2))
    u[:9, 0] = [5, -5] * 4 + [5]
    undefined = stretching(X, X + u, np.ones(109, bool), 1.0, 10)
    assert not undefined.defined
    assert np.isnan(undefined.angle)
    assert (undefined.confidence, undefined.seen, undefined.moving) == (0, 109, 9)
    assert stretching(X, X + u, np.ones(109, bool), 1.0, 9).defined


def test_unseen_points_and_positions_that_are_not_finite_are_left_out() -> None:
    X = disk()
    x = (X - (64, 64)) @ stretch(30, 1.4).T + (64, 64)
    spoilt, seen = x.copy(), SEEN.copy()
    # Mirror images leave together, so that the mean stays.
    spoilt[[0, 200]] = np.nan
    spoilt[[1, 201], 0] = np.inf
    spoilt[[2, 202]] += (500, 900)
    seen[[2, 202]] = False
    found = stretching(X, spoilt, seen, 0.1, 10)
    assert found.seen == 394
    assert between(found.angle, 30) < ROUND_OFF


@pytest.mark.parametrize(("tau", "k"), [(0.0, 10), (0.0, 1), (1.0, 1)])
def test_without_motion_or_points_there_is_no_axis(tau: float, k: int) -> None:
    X = disk()
    assert not stretching(X, X + (3, 3), SEEN, max(tau, 1e-9), k).defined
    assert not stretching(X[:0], X[:0], SEEN[:0], tau, k).defined
    assert not stretching(X[:5], X[:5], SEEN[:5], tau, k).defined


def test_angles_between_axes_know_no_sign_and_no_turn() -> None:
    assert between(10, 170) == 20
    assert between(0, 180) == 0
    assert between(5, 95) == 90
    assert np.isnan(between(float("nan"), 3))
    # arccos of a dot product would lose this: 1 - cos(1e-7 deg) is below the spacing of doubles.
    assert between(30, 30 + 1e-7) == pytest.approx(1e-7, rel=1e-6)
    assert similarity(15, 15) == pytest.approx(np.exp(-1))
