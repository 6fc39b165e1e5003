"""The camera sees the whole pull, and all pictures of a frame cover the same pixels."""

import numpy as np
import pytest

from fracsim import Camera, Capture, Fracture, Loading, Material, Scene, Solver
from fracsim.camera import project
from fracsim.records import Frame, Particles
from fracsim.render.film import Film, view_of
from fracsim.scene.vocab import CENTRE
from fracsim.solve.simulator import Simulator

from .sim.bars import bar, scene


@pytest.mark.parametrize("axis", range(0, 180, 15))
def test_default_view_holds_the_whole_motion_of_the_grips(axis: int) -> None:
    s = Scene(loading=Loading(axis_deg=axis, speed=1.4, offset=0.25))
    view = view_of(s)
    way = s.loading.offset + s.loading.thickness / 2 + s.loading.speed * s.capture.duration
    ends = np.asarray(CENTRE) + np.array([[way], [-way]]) * np.asarray(s.loading.axis)
    xy, depth = project(view, ends)
    assert (xy >= 0).all()
    assert (xy <= [view.width, view.height]).all()
    assert (depth > 0).all()


def test_explicit_camera_is_taken_as_it_is() -> None:
    matrix = np.eye(4)
    matrix[2, 3] = 3.0
    camera = Camera(width=64, height=32, matrix=matrix.ravel().tolist(), intrinsics=[50.0, 60.0, 32.0, 16.0])
    view = view_of(Scene(camera=camera))
    assert (view.fx, view.fy, view.cx, view.cy, view.width, view.height) == (50, 60, 32, 16, 64, 32)
    xy, depth = project(view, np.array([[1.0, 0.5, 1.0]]))
    assert depth == pytest.approx([4.0])
    assert xy[0] == pytest.approx([32 + 50 / 4, 16 + 60 * 0.5 / 4])


def torn() -> tuple[Film, Particles, Frame]:
    """A bar that has just parted."""
    s = scene(
        material=Material(law="fixed_corotated", E=2e3, nu=0.3),
        fracture=Fracture(onset=1.2, crit=1.4),
        loading=Loading(speed=1.0),
        solver=Solver(cells=40),
        camera=Camera(width=128, height=64, half_width=0.6),
        capture=Capture(frames=20),
    )
    simulator = Simulator(s, bar(s.solver))
    *_, last = simulator.frames()
    assert simulator.report.break_frame is not None
    return Film(s), simulator.particles, last


def test_maps_and_colour_cover_the_same_pixels() -> None:
    film, body, frame = torn()
    picture = film.shoot(frame, body)
    assert picture.rgb is not None
    assert picture.alpha is not None
    empty = picture.alpha == 0
    assert empty.any()
    assert (picture.rgb[empty] == 255).all()
    for values in picture.maps.values():
        assert (values[empty] == 0).all()
    # Every particle moves, so the flow map is nonzero wherever there is coverage.
    assert (np.abs(picture.maps["flow"]).sum(axis=-1)[~empty] > 0).all()
    damage = picture.maps["damage"][..., 0]
    assert damage.max() > 0.9
    assert (damage <= picture.alpha + 1e-5).all()


def test_failed_particles_make_no_needles() -> None:
    """The covariance of a failed particle is stretched no more than that of the intact ones."""
    film, body, frame = torn()
    assert frame.failed.any()
    stretch = np.linalg.svd(frame.F, compute_uv=False)[:, 0]
    assert stretch[frame.failed].max() <= 1.4 * 1.02
    means, covariance, _, _ = film.gaussians(frame, body)
    assert np.isfinite(means).all()
    assert np.isfinite(covariance).all()


def test_tracks_follow_surface_particles() -> None:
    film, body, frame = torn()
    body = Particles(**{**vars(body), "surface": np.abs(body.X[:, 2] - body.X[:, 2].max()) < 1e-4})
    picture = film.shoot(frame, body)
    tracked = film.choose_tracks(frame, body, picture)
    assert body.surface[tracked].all()
    xy, visible = film.tracks(frame, tracked, picture)
    assert np.allclose(xy, project(film.view, frame.x[tracked])[0])
    assert visible.mean() > 0.9
