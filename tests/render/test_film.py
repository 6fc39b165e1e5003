"""All pictures of a frame cover the same pixels, and tracks follow particles."""

import numpy as np

from fracsim import Camera, Capture, Fracture, Loading, Material, Solver
from fracsim.camera import depths, project
from fracsim.records import Frame, Particles
from fracsim.render.film import Film
from fracsim.solve.simulator import Simulator
from tests.sim.bars import bar, scene


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


def still(camera: Camera) -> Film:
    """The film of a small bar at rest."""
    s = scene(solver=Solver(cells=40), camera=camera, capture=Capture(frames=1))
    body = bar(s.solver)
    frame = next(iter(Simulator(s, body).frames()))
    film = Film(s)
    film.shoot(frame, body)
    assert film.view.near > 0
    culled = int((depths(film.view, frame.x) <= film.view.near).sum())
    assert [str(culled) in w for w in film.warnings() if "not drawn" in w] == [True] * (culled > 0)
    return film


def test_a_film_that_shows_all_has_no_warnings() -> None:
    assert still(Camera(width=64, height=64)).warnings() == []


def test_a_film_tells_how_many_particles_it_culls_and_when() -> None:
    """The eye at the centre of the object sees half of it, but for what is nearer than the near plane."""
    inside = np.eye(4)
    inside[:3, 3] = -1 - np.array([0.0, 0, 0.01])
    camera = Camera(width=64, height=64, matrix=inside.ravel().tolist(), intrinsics=[40, 40, 32, 32])
    (warning,) = still(camera).warnings()
    assert "particles of frame 0 are not drawn, since they are nearer than" in warning


def test_an_empty_film_says_so() -> None:
    away = np.diag([1.0, -1, -1, 1])
    away[:3, 3] = [-1, 1, -3]  # at z = -3, looking along -z
    camera = Camera(width=64, height=64, matrix=away.ravel().tolist(), intrinsics=[40, 40, 32, 32])
    warnings = still(camera).warnings()
    assert "frame 0 are empty" in warnings[-1]
    assert len(warnings) == 2  # all particles lie behind the eye


def test_a_film_tells_when_it_narrows_the_field_of_view() -> None:
    (warning,) = still(Camera(width=64, height=64, half_width=0.05)).warnings()
    assert "camera.fov_deg=40 would bring the eye into the reach of the object" in warning
