"""SAC on tracks that are known, so that every score has a closed form."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

import fracgen
from fracgen.evaluation.clip import Clip, LackingError
from fracgen.evaluation.queries import grid
from fracgen.metrics import sac
from fracsim.records import Array
from tests.metrics.films import disk, ellipse, pair, stretch, tracked

NEAR = 0.01
"""Queries follow the nearest particle, and are weighted by where the grid has them: of motion along one line, nothing
of this changes the axis; round-off of float32 and the removed mean do, by less than this angle [deg]."""
CONF = Path(fracgen.__file__).parents[2] / "conf/metric/sac.yaml"


def metric(**settings: object) -> sac.Sac:
    options = {"tracker": "simulator", **settings}
    return sac.build(sac.Settings(**options))


def pull(angle: float, frames: int = 21, size: int = 128, **more: object) -> Clip:
    """A pull along a line by 20 % in a tenth of the clip."""
    moves = [stretch(angle, 1 + 0.2 * t / (0.1 * (frames - 1))) for t in range(frames)]
    points = disk(radius=30 * size / 128, centre=(size / 2, size / 2))
    return tracked(points, moves, (size, size), **more)


def observe(pred: Clip, gt: Clip, **settings: object) -> dict[str, float]:
    return metric(**settings).observe(pair(pred, gt))


def test_the_yaml_file_has_the_defaults() -> None:
    assert sac.Settings(**OmegaConf.to_container(OmegaConf.load(CONF))) == sac.Settings()


def test_a_clip_against_itself_scores_its_confidence() -> None:
    seen = observe(pull(30), pull(30))
    assert seen["sac"] == seen["sac_confidence"] == seen["sac_ceiling"]
    assert seen["sac_theta"] == 0
    assert seen["sac_angle_gt"] == pytest.approx(30, abs=NEAR)


@pytest.mark.parametrize("off", [5.0, 10.0, 15.0, 90.0])
def test_a_pull_along_another_axis_scores_the_kernel(off: float) -> None:
    seen = observe(pull(30 + off), pull(30))
    assert seen["sac_theta"] == pytest.approx(off, abs=NEAR)
    # c is 1 for motion along one line.
    assert seen["sac"] == pytest.approx(np.exp(-((off / 15) ** 2)), rel=2 * off / 15**2 * NEAR + 1e-4)


def test_a_picture_squeezed_by_a_half_costs_what_its_axis_turns() -> None:
    # At 45 degrees, (1, 1) becomes (1, 1 / 1.5): 33.69 degrees, exp(-(11.31 / 15)^2) = 0.566.
    F = np.diag([1, 1 / 1.5])
    points = (disk() - (64, 64)) @ F.T + (64, 64)
    moves = [F @ stretch(45, 1 + 0.1 * t) @ np.linalg.inv(F) for t in range(21)]
    assert observe(tracked(points, moves), pull(45))["sac"] == pytest.approx(0.566, abs=2e-3)


@pytest.mark.parametrize("size", [96, 256, 480])
def test_a_score_does_not_depend_on_the_resolution(size: int) -> None:
    # At 0.25 of their distance from the edge of a mask all over, no point of the 60 x 60 is a tie.
    small = observe(pull(50), pull(30), erode=0.25)
    large = observe(pull(50, size=size), pull(30, size=size), erode=0.25)
    assert large["sac"] == pytest.approx(small["sac"], rel=1e-3)
    assert large["sac_queries"] == small["sac_queries"] == 3600


def test_drift_does_not_change_a_score() -> None:
    drifting = pull(40)
    tracks = drifting.get("tracks")
    moved = tracks._replace(xy=tracks.xy + np.arange(21)[:, None, None] * np.array([2.0, -1.0]))
    assert observe(pull(40, tracks=moved), pull(30))["sac"] == pytest.approx(
        observe(drifting, pull(30))["sac"], abs=1e-9
    )


def test_a_frozen_prediction_scores_zero_and_a_frozen_truth_is_left_out() -> None:
    still = tracked(disk(), [np.eye(2)] * 21)
    assert observe(still, pull(30))["sac"] == 0
    assert np.isnan(observe(pull(30), still)["sac"])
    both = metric()
    for pred, gt in ((still, pull(30)), (pull(30), pull(30)), (pull(30), still), (still, still)):
        both.update(pair(pred, gt))
    result = both.compute()
    assert result["sac"] == pytest.approx(0.5, abs=1e-6)
    assert (result["sac_n"], result["sac_undefined_gt"], result["sac_undefined_pred"]) == (2, 2, 1)
    assert result["sac_ceiling"] == pytest.approx(1, abs=1e-6)


def test_motion_after_the_window_does_not_count() -> None:
    turned = [stretch(30, 1 + 0.1 * t) for t in range(3)] + [stretch(120, 3.0)] * 18
    assert observe(tracked(disk(), turned), pull(30))["sac_theta"] == pytest.approx(0, abs=NEAR)


@pytest.mark.parametrize(("frames", "t1"), [(81, 8), (21, 2), (2, 1), (5, 1)])
def test_the_window_is_a_tenth_of_the_steps_and_at_least_one(frames: int, t1: int) -> None:
    # Nothing moves before the last frame of the window.
    moves = [np.eye(2)] * t1 + [stretch(30, 1.5)] * (frames - t1)
    clip = tracked(disk(), moves)
    assert observe(clip, clip)["sac_angle_gt"] == pytest.approx(30, abs=NEAR)
    shorter = metric(window=(t1 - 1) / (frames - 1))
    assert t1 == 1 or np.isnan(shorter.observe(pair(clip, clip))["sac"])


def test_one_frame_is_too_few() -> None:
    with pytest.raises(LackingError, match="needs 2"):
        observe(pull(30, frames=2), tracked(disk(), [np.eye(2)]))


def test_an_even_expansion_of_the_prediction_scores_next_to_nothing() -> None:
    expansion = tracked(disk(), [np.eye(2) * (1 + 0.1 * t) for t in range(21)])
    seen = observe(expansion, pull(30))
    assert seen["sac_confidence"] < 0.05
    assert seen["sac"] <= seen["sac_confidence"]


def test_points_that_are_lost_are_shown() -> None:
    clip = pull(30)
    tracks = clip.get("tracks")
    seen = tracks.visible.copy()
    seen[2] = False
    lost = observe(pull(30, tracks=tracks._replace(visible=seen)), clip)
    assert lost["sac"] == 0
    assert lost["sac_seen_pred"] == lost["sac_moving_pred"] == 0
    # The object, a disk of radius 30 px, and 0.03 * 128 px around it are near a particle.
    assert 0.1 < lost["sac_seen_gt"] < np.pi * 34**2 / 128**2 + 0.02


def test_an_object_too_small_for_a_point_has_no_axis() -> None:
    empty = np.zeros((21, 128, 128), np.float32)
    seen = observe(pull(30), pull(30, alpha=empty))
    assert np.isnan(seen["sac"])
    assert seen["sac_queries"] == 0


def test_flow_on_films_finds_the_axis() -> None:
    # Both films are tracked; chained flow finds axes within 2 degrees, so that theta is within 4 of 20.
    def film(angle: float) -> Clip:
        return ellipse([(stretch(angle, 1 + 0.05 * t), (0.5 * t, 0.0)) for t in range(3)])

    m = sac.build(sac.Settings(window=1.0))
    seen = m.observe(pair(film(50), film(30)))
    assert seen["sac_angle_gt"] == pytest.approx(30, abs=2)
    assert seen["sac_theta"] == pytest.approx(20, abs=4)
    assert seen["sac_ceiling"] > 0.9
    assert seen["sac_seen_gt"] > 0.9
    assert m.about()["tracker"]["tracker"] == "dis"


def test_trackers_may_differ_and_have_settings() -> None:
    m = sac.build(sac.Settings(tracker="dis", options={"preset": "fast"}, gt_tracker="simulator"))
    about = m.about()
    assert (about["tracker"]["preset"], about["gt_tracker"]["tracker"], about["tau"]) == ("fast", "simulator", 0.0025)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"tracker": "diss"}, "metric.sac.tracker=diss.*dis"),
        ({"options": {"speed": 1}}, "metric.sac.options.*simulator: it has radius"),
        ({"gt_options": {"radius": 1}}, "metric.sac.gt_tracker"),
        ({"sigma": 0.0}, "metric.sac.sigma=0"),
    ],
)  # fmt: skip
def test_bad_settings_are_named(settings: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        metric(**settings)


def test_a_clip_without_tracks_says_so() -> None:
    with pytest.raises(LackingError, match="no tracks"):
        observe(ellipse([(np.eye(2), (0, 0))] * 3), pull(30, frames=3))


def test_the_grid_lies_inside_the_object() -> None:
    mask = np.zeros((40, 60), bool)
    mask[10:30, 20:50] = True
    points = grid(mask, 2.0, 3.0)
    x, y = points.T
    # The object is [20, 50] x [10, 30] px; 3 px inside its edge [23, 47] x [13, 27], in steps of 2 from 1.
    assert sorted(set(x)) == list(np.arange(23, 48, 2.0))
    assert sorted(set(y)) == list(np.arange(13, 28, 2.0))
    assert len(grid(np.zeros((8, 8), bool), 1.0, 0.0)) == 0
    edge: Array = grid(np.ones((8, 8), bool), 1.0, 1.0)
    assert len(edge) == 36  # the picture's border is an edge
