"""Trackers on films whose motion is known."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from fracgen.evaluation import foreground
from fracgen.evaluation.clip import Clip, LackingError
from fracgen.evaluation.queries import grid
from fracgen.evaluation.weights import MissingWeightsError
from fracgen.trackers import cotracker3, dis, lk, simulator, tracks_file
from fracsim import registry
from fracsim.records import Array
from tests.metrics.films import clip, disk, ellipse, stretch, tracked

HALF = 0.5
"""Error of flow that a picture of 128 with texture permits [px]: half of its grid."""
FLOWS = pytest.mark.parametrize("module", [dis, lk], ids=["dis", "lk"])
STILL = (np.eye(2), (0.0, 0.0))


def queries(film: Clip) -> Array:
    return grid(foreground.mask(film, 0), 6.0, 4.0)


def follow(module: Any, film: Clip, t0: int = 0, t1: int | None = None, **settings: Any) -> tuple[Array, Array, Array]:
    """Queries, their tracks, and whether they are seen."""
    points = queries(film)
    return points, *module.build(module.Settings(**settings))(film, points, t0, film.frames - 1 if t1 is None else t1)


def test_every_tracker_is_found() -> None:
    assert registry.names("fracgen.trackers") == ("cotracker3", "dis", "lk", "simulator", "tracks_file")
    for name in registry.names("fracgen.trackers"):
        assert registry.load("fracgen.trackers", name, "metric.sac.tracker").Settings()


@FLOWS
@pytest.mark.parametrize("side", [96, 128, 480])
def test_flow_follows_a_stretch_and_a_drift(module: Any, side: int) -> None:
    last = (stretch(30, 1.1), (0.02 * side, -0.01 * side))
    film = ellipse([STILL, (stretch(30, 1.05), (0.01 * side, -0.005 * side)), last], side)
    points, tracks, seen = follow(module, film)
    assert tracks.shape == (3, len(points), 2)
    assert (tracks.dtype, seen.dtype, seen.shape) == (np.float64, bool, (3, len(points)))
    np.testing.assert_allclose(tracks[0], points, atol=1e-9)
    exact = (points - side / 2) @ last[0].T + side / 2 + last[1]
    assert seen[-1].mean() > 0.9
    assert np.median(np.linalg.norm(tracks[-1] - exact, axis=1)[seen[-1]]) < HALF * side / 128


@FLOWS
def test_enlarging_a_small_picture_makes_flow_more_exact(module: Any) -> None:
    film = ellipse([STILL, (stretch(30, 1.1), (2.0, -1.0)), (stretch(30, 1.2), (4.0, -2.0))], side=96)
    errors = []
    for side in (16, 256):
        points, tracks, seen = follow(module, film, side=side)
        exact = (points - 48) @ stretch(30, 1.2).T + 48 + (4, -2)
        errors.append(np.median(np.linalg.norm(tracks[-1] - exact, axis=1)[seen[-1]]))
    assert errors[1] < errors[0]


@FLOWS
def test_flow_begins_and_ends_where_it_is_told(module: Any) -> None:
    film = ellipse([(np.eye(2), (3.0 * t, 0.0)) for t in range(4)])
    points, tracks, seen = follow(module, film, t0=1, t1=2)
    assert len(tracks) == len(seen) == 2
    inner = seen[-1]
    assert np.median((tracks[1] - points)[inner], axis=0) == pytest.approx([3, 0], abs=HALF)


@FLOWS
def test_points_whose_surroundings_are_replaced_are_lost_for_good(module: Any) -> None:
    film = ellipse([STILL] * 4)
    rgb = film.rgb.copy()
    rgb[2:, :, 64:] = np.random.default_rng(3).integers(0, 255, (2, 128, 64, 3), np.uint8)
    points, _, seen = follow(module, clip(frames=4, rgb=rgb, alpha=film.alpha))
    far = points[:, 0] > 64 + 12
    assert seen[:, points[:, 0] < 64 - 12].mean() > 0.95
    assert seen[3, far].mean() < 0.3
    assert (seen[3] <= seen[2]).all()


@FLOWS
def test_points_that_leave_the_picture_are_lost(module: Any) -> None:
    film = ellipse([(np.eye(2), (8.0 * t, 0.0)) for t in range(6)])
    points, tracks, seen = follow(module, film)
    gone = points[:, 0] + 40 > 128 + 4
    assert gone.any()
    assert not seen[-1, gone].any()
    assert (tracks[-1][seen[-1]] <= 128).all()


@FLOWS
def test_an_object_without_texture_loses_most_of_its_points(module: Any) -> None:
    film = ellipse([STILL, (stretch(30, 1.1), (3.0, 0.0)), (stretch(30, 1.2), (6.0, 0.0))])
    flat = np.where(film.alpha[..., None] > 0, np.uint8(120), np.uint8(255)).repeat(3, axis=-1)
    seen = [follow(module, one)[2][-1].mean() for one in (film, clip(frames=3, rgb=flat, alpha=film.alpha))]
    assert seen[0] > 0.9
    assert seen[1] < 0.6


@FLOWS
def test_no_points_are_no_tracks(module: Any) -> None:
    film = ellipse([STILL] * 2)
    tracks, seen = module.build(module.Settings())(film, np.empty((0, 2)), 0, 1)
    assert (tracks.shape, seen.shape) == ((2, 0, 2), (2, 0))


@FLOWS
def test_without_opencv_the_way_out_is_named(module: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(MissingWeightsError, match=r"needs OpenCV: pip install 'fracsim\[metrics\]'"):
        module.build(module.Settings())


def test_the_simulator_moves_queries_as_the_nearest_particle_that_is_seen() -> None:
    points = np.array([[10.0, 10.0], [20.0, 10.0], [12.0, 10.0]])
    film = tracked(points, [np.eye(2)] * 2)
    tracks = film.get("tracks")
    tracks.xy[1] += [[1, 2], [3, 4], [9, 9]]
    tracks.visible[0, 2] = False
    tracks.visible[1, 1] = False
    film = clip(frames=2, tracks=tracks)
    at = np.array([[12.0, 10.0], [19.0, 10.0], [60.0, 60.0]])
    moved, seen = simulator.build(simulator.Settings())(film, at, 0, 1)
    np.testing.assert_allclose(moved[1, :2], [[13, 12], [22, 14]])
    # The third is 0.03 * 128 px from none; the second's particle is covered at the end.
    assert seen.tolist() == [[True, True, False], [True, False, False]]


def test_the_simulator_without_a_particle_in_sight_sees_nothing() -> None:
    film = tracked(disk(), [np.eye(2)] * 2)
    film.get("tracks").visible[:] = False
    _, seen = simulator.build(simulator.Settings())(film, disk(), 0, 1)
    assert not seen.any()


def test_a_file_of_tracks_is_read_in_the_pixels_of_the_clip(tmp_path: Path) -> None:
    film = tracked(disk(), [np.eye(2), stretch(20, 1.3)])
    own = film.get("tracks")
    np.savez(tmp_path / "clip.npz", tracks=4 * own.xy, visible=own.visible, size=[512, 512])
    tracker = tracks_file.build(tracks_file.Settings(folder=str(tmp_path)))
    moved, seen = tracker(film, disk(), 0, 1)
    np.testing.assert_allclose(moved, own.xy, atol=1e-9)
    assert seen.all()
    own.xy[1, 0] = np.nan
    np.savez(tmp_path / "clip.npz", tracks=own.xy)
    assert tracker(film, disk(), 0, 1)[1].sum() == 2 * 400 - 1


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        (None, "cannot be read"),
        ({"points": np.zeros((2, 5, 2))}, r"must hold tracks of shape \(T, M, 2\) with T = 2"),
        ({"tracks": np.zeros((3, 5, 2))}, r"it has \(3, 5, 2\)"),
        ({"tracks": np.zeros((2, 5, 2)), "visible": np.ones((2, 4))}, r"visible must have the shape \(2, 5\)"),
    ],
)  # fmt: skip
def test_files_of_tracks_that_do_not_fit_are_named(tmp_path: Path, arrays: dict[str, Array] | None, said: str) -> None:
    if arrays is not None:
        np.savez(tmp_path / "clip.npz", **arrays)
    tracker = tracks_file.build(tracks_file.Settings(folder=str(tmp_path)))
    with pytest.raises(LackingError, match=said):
        tracker(clip(frames=2), np.zeros((1, 2)), 0, 1)


def test_a_folder_of_tracks_that_is_not_there_is_named() -> None:
    with pytest.raises(ValueError, match=r"tracker\.tracks_file\.folder=nowhere"):
        tracks_file.build(tracks_file.Settings(folder="nowhere"))


HUBCONF = """
import torch

class Predictor(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.model = torch.nn.Linear(1, 2, bias=False)

    def forward(self, video, queries):
        frames = torch.arange(video.shape[1])[None, :, None, None]
        moved = queries[:, None, :, 1:] + (frames - queries[:, None, :, :1]) * self.model.weight[:, 0]
        return moved, video.mean() + 0 * moved[..., 0] > 1

def cotracker3_offline(*, pretrained):
    assert not pretrained
    return Predictor()
"""
"""A stand-in with the calls of CoTracker3: its weights are a speed [px a frame]."""


def test_what_is_around_cotracker3_gives_it_queries_and_weights(tmp_path: Path) -> None:
    (tmp_path / "hubconf.py").write_text(HUBCONF)
    torch.save({"weight": torch.tensor([[2.0], [-1.0]])}, tmp_path / "scaled_offline.pth")
    settings = cotracker3.Settings(repo=str(tmp_path), checkpoint=str(tmp_path / "scaled_offline.pth"), device="cpu")
    tracker = cotracker3.build(settings)
    film = ellipse([STILL] * 4)
    tracks, seen = tracker(film, np.array([[64.0, 64.5]]), 1, 3)
    np.testing.assert_allclose(tracks[:, 0], [[64, 64.5], [66, 63.5], [68, 62.5]])
    assert seen.all()
    assert len(tracker.about()["sha256"]) == 64


def test_cotracker3_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FRACGEN_COTRACKER3", raising=False)
    with pytest.raises(ValueError, match=r"tracker\.cotracker3\.repo= is no checkout"):
        cotracker3.build(cotracker3.Settings())
    (tmp_path / "hubconf.py").write_text(HUBCONF)
    with pytest.raises(MissingWeightsError, match=r"scaled_offline\.pth.*FRACGEN_COTRACKER3"):
        cotracker3.build(cotracker3.Settings(repo=str(tmp_path)))
