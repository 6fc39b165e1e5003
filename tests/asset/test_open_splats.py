"""Clouds of Gaussians that are open on a side, as scans of what stands on a table: solid, and it is said."""

import numpy as np
import pytest
import trimesh

from fracsim.asset import ply, splat
from fracsim.scene.vocab import Asset

SPACING = 0.02


def discs(mesh, n, path, keep=None, rotate=None):
    """Flat Gaussians, evenly spread on a mesh, without those whose point (N, 3) and normal (N, 3) are not kept."""
    points, face = trimesh.sample.sample_surface_even(mesh, n, seed=0)
    normal = mesh.face_normals[face]
    kept = np.ones(len(points), bool) if keep is None else keep(points, normal)
    points, normal = points[kept], normal[kept]
    R = np.eye(3) if rotate is None else rotate
    points, normal = points @ R.T, normal @ R.T
    wide = 0.7 * np.sqrt(mesh.area / n)
    A = wide**2 * (np.eye(3) - 0.98 * normal[:, :, None] * normal[:, None, :])
    ply.write(path, points, ply.triangle(A), np.full(len(points), 0.9), np.zeros((len(points), 1, 3)))
    return path


def prepared(path, spacing=SPACING):
    return splat.prepare(Asset(kind="ply", path=str(path)), spacing, 0)


BOX = trimesh.creation.box((1.0, 0.6, 0.6))


@pytest.mark.parametrize("spacing", [0.03, 0.02, 0.012])
def test_an_unseen_underside_does_not_make_it_hollow(tmp_path, spacing):
    """Within one and a half cells of the closed box: cells at a face count half, wherever the lattice has them."""
    closed = prepared(discs(BOX, 12000, tmp_path / "closed.ply"), spacing)
    opened = prepared(discs(BOX, 12000, tmp_path / "open.ply", lambda P, N: N[:, 1] > -0.5), spacing)
    assert opened.volume.sum() == pytest.approx(closed.volume.sum(), rel=1.5 * spacing / 0.36)
    note = next(n for n in opened.notes if "open on one side" in n)
    assert "found by rays" in note
    assert not any("open on one side" in n or "hollow" in n for n in closed.notes)


@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("side", [-1, 1])
def test_any_side_may_be_the_open_one(tmp_path, axis, side):
    opened = prepared(discs(BOX, 12000, tmp_path / "open.ply", lambda P, N: side * N[:, axis] < 0.5))
    assert opened.volume.sum() == pytest.approx(0.6**3 * 0.36, rel=0.08)


@pytest.mark.parametrize("degrees", [20, 45])
def test_the_open_side_may_be_askew(tmp_path, degrees):
    R = trimesh.transformations.rotation_matrix(np.radians(degrees), (0.3, 0.2, 1.0))[:3, :3]
    closed = prepared(discs(BOX, 12000, tmp_path / "closed.ply", rotate=R))
    opened = prepared(discs(BOX, 12000, tmp_path / "open.ply", lambda P, N: N[:, 1] > -0.5, R))
    # Rays along 26 directions lose or add a wedge at the opening.
    assert opened.volume.sum() == pytest.approx(closed.volume.sum(), rel=0.15)


def test_a_dome_is_filled_to_its_rim(tmp_path):
    ball = trimesh.creation.icosphere(4)
    opened = prepared(discs(ball, 12000, tmp_path / "dome.ply", lambda P, N: P[:, 1] > -0.2))
    # Of the ball below: a cap of height 0.8.
    left = 1 - 0.8**2 * (3 - 0.8) / 4
    assert opened.volume.sum() == pytest.approx(left * 4 / 3 * np.pi * 0.3**3, rel=0.08)


def test_a_vessel_with_walls_keeps_its_cavity(tmp_path):
    """A cup whose walls are five spacings thick, seen from outside and inside."""
    cup = trimesh.creation.revolve([(0, -1), (0.9, -1), (0.9, 1), (0.57, 1), (0.57, -0.67), (0, -0.67)], sections=48)
    particles = prepared(discs(cup, 20000, tmp_path / "cup.ply"))
    assert particles.volume.sum() == pytest.approx(cup.volume * 0.3**3, rel=0.1)
    r = np.hypot(particles.X[:, 0] - 1, particles.X[:, 1] - 1)
    assert not ((r < 0.1) & (particles.X[:, 2] > 1)).any()
    assert not any("open on one side" in n for n in particles.notes)


def test_a_sheet_stays_a_sheet(tmp_path):
    """A wavy sheet encloses nothing and is open on two sides."""
    x, z = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 80), np.linspace(-1, 1, 80)))
    P = np.stack([x, 0.1 * np.sin(3 * x), z], axis=1)
    A = np.tile(np.array([0.02, 0, 0, 0.002, 0, 0.02]) ** 2, (len(P), 1))
    ply.write(tmp_path / "sheet.ply", P, A, np.full(len(P), 0.9), np.zeros((len(P), 1, 3)))
    particles = prepared(tmp_path / "sheet.ply")
    assert particles.volume.sum() < 0.6 * 0.6 * 3 * SPACING
    assert any("enclose nothing" in n and "solver.cells" not in n for n in particles.notes)
