"""Surfaces that are closed, broken, turned about or in each other, and the tools that tell inside from outside."""

import itertools
import re

import numpy as np
import pytest
import trimesh

from fracsim.asset import weld
from fracsim.asset.nearest import Nearest
from fracsim.asset.rays import Rays

from .meshes import BALL, SPACING, pieces, prepared, scaled, solid_angle_winding


def inverted(ball):
    ball.invert()


def half_flipped(ball):
    turn = np.random.default_rng(0).random(len(ball.faces)) < 0.5
    ball.faces[turn] = ball.faces[turn][:, ::-1]


def doubled(ball):
    ball.faces = np.concatenate([ball.faces, ball.faces[::3, ::-1]])


@pytest.mark.parametrize("harm", [inverted, half_flipped, doubled])
def test_orientation_does_not_matter_to_a_closed_surface(tmp_path, harm):
    ball = BALL.copy()
    harm(ball)
    particles = prepared(trimesh.Trimesh(ball.vertices, ball.faces, process=False), tmp_path / "ball.ply")
    assert particles.volume.sum() == pytest.approx(scaled(BALL.volume, BALL), rel=1e-4)


@pytest.mark.parametrize("flip", [False, True])
def test_holes_are_bridged_and_it_is_said(tmp_path, flip):
    """A ball without its cap above y = 0.8 r is filled up to there: the cap's volume is pi 0.2^2 (3 - 0.2) / 3 r^3."""
    ball = trimesh.creation.icosphere(4)
    ball.update_faces(ball.triangles_center[:, 1] < 0.8)
    if flip:
        half_flipped(ball)
    particles = prepared(ball, tmp_path / "ball.ply")
    left = 1 - 0.2**2 * (3 - 0.2) / 4
    # The rim of faces is jagged by an edge, 0.07 r: the lid is up to 1.5 % of the volume off.
    assert particles.volume.sum() == pytest.approx(left * 4 / 3 * np.pi * 0.3**3, rel=0.02)
    note = next(n for n in particles.notes if "not watertight" in n)
    assert re.search(r"[\d.]+%", note)
    assert len(pieces(particles, 1.6 * SPACING)) == 1
    assert np.linalg.norm(particles.X - particles.X.mean(0), axis=1).max() < 0.33


def test_lost_faces_leave_no_stray_particles(tmp_path):
    """One face in ten is gone: nothing outside, one piece, the volume within 2 %."""
    ball = trimesh.creation.icosphere(4)
    ball.update_faces(np.random.default_rng(0).random(len(ball.faces)) < 0.9)
    particles = prepared(ball, tmp_path / "ball.ply")
    assert np.linalg.norm(particles.X - 1, axis=1).max() < 0.3
    assert len(pieces(particles, 1.6 * SPACING)) == 1
    assert particles.volume.sum() == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.02)


def test_bodies_that_overlap_count_once(tmp_path):
    """Two unit balls a radius apart share a lens of volume 5 pi / 12."""
    other = BALL.copy()
    other.apply_translation((1, 0, 0))
    both = trimesh.util.concatenate([BALL, other])
    particles = prepared(both, tmp_path / "both.ply", spacing=SPACING / 2)
    union = (2 * 4 / 3 - 5 / 12) * np.pi * (BALL.volume / (4 / 3 * np.pi))
    assert particles.volume.sum() == pytest.approx(scaled(union, both), rel=0.01)
    # Faces within the other body make no surface particles.
    x = np.abs(particles.X[particles.surface] - 1)
    assert not ((x[:, 0] < 0.02) & (np.hypot(x[:, 1], x[:, 2]) < 0.1)).any()


def test_a_cavity_stays_empty(tmp_path):
    hole = BALL.copy()
    hole.apply_scale(0.6)
    hole.invert()
    particles = prepared(trimesh.util.concatenate([BALL, hole]), tmp_path / "shell.ply")
    assert particles.volume.sum() == pytest.approx(scaled(BALL.volume * (1 - 0.6**3), BALL), rel=1e-4)
    assert np.linalg.norm(particles.X - 1, axis=1).min() > 0.6 * 0.3


def test_rotation_turns_the_object(tmp_path):
    """A bar along z, drawn z up, stands along y after [-90, 0, 0]."""
    bar = trimesh.creation.box((0.2, 0.3, 1))
    particles = prepared(bar, tmp_path / "bar.stl", rotate_deg=[-90.0, 0.0, 0.0])
    assert np.allclose(np.ptp(particles.X, axis=0), (0.12, 0.6, 0.18), atol=0.5001 * SPACING)


def test_winding_from_rays_is_that_from_solid_angles():
    """Inside or outside: rays along the axes agree with the closed formula for a closed mesh, at every grid point."""
    thing = trimesh.creation.torus(0.5, 0.2, major_sections=24, minor_sections=12)
    axes = [np.linspace(-0.81, 0.8, 17), np.linspace(-0.82, 0.8, 19), np.linspace(-0.31, 0.3, 9)]
    index = np.array(list(itertools.product(range(17), range(19), range(9))))
    P = np.stack([axes[k][index[:, k]] for k in range(3)], axis=1)
    expected = np.rint(solid_angle_winding(thing.triangles, P))
    for closed in (True, False):
        winding, doubtful = Rays(thing.triangles, axes, closed, oriented=True).winding(index)
        assert np.array_equal(np.rint(winding), expected)
        assert not doubtful.any()
    assert np.array_equal(Rays(thing.triangles, axes, True, oriented=False).winding(index)[0], expected)


def test_the_nearest_point_is_that_of_brute_force():
    """Slim and large triangles: the distance is that to all triangles, and the barycentric weights give the point."""
    thing = trimesh.creation.cone(0.3, 1.0, sections=12)
    nearest = Nearest(thing.triangles, 0.05)
    P = np.random.default_rng(2).uniform(-0.5, 1.1, (200, 3))
    S, face, bary = nearest(P)
    each = [trimesh.triangles.closest_point(thing.triangles, np.tile(p, (len(thing.faces), 1))) for p in P]
    exact = np.array([np.linalg.norm(e - p, axis=1).min() for e, p in zip(each, P, strict=True)])
    # Candidates come from samples 0.05 apart: a face that is nearer by less than their offsets may be missed.
    assert np.allclose(np.linalg.norm(S - P, axis=1), exact, atol=0.05**2)
    assert np.allclose(np.einsum("nc,ncj->nj", bary, thing.triangles[face]), S)


def test_welding_finds_seams_closed_and_holes_open():
    soup = BALL.triangles
    assert weld.weld(soup).closed
    assert weld.weld(soup).oriented
    assert weld.weld(soup).volume == pytest.approx(BALL.volume)
    assert not weld.weld(soup[1:]).closed
