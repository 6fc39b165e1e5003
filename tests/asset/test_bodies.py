"""What of a surface is the object: parts that enclose nothing do not decide its size, bodies are turned outward."""

import numpy as np
import pytest
import trimesh

from fracsim.asset import bodies, orient, weld

from .meshes import BALL, SPACING, prepared, scaled


def moved(mesh, *shift):
    out = mesh.copy()
    out.apply_translation(shift)
    return out


def plane(size, y=-1.0, cells=1):
    """A square of 2 cells^2 triangles at the height y, a little wavy if there are many."""
    u = np.linspace(-size, size, cells + 1)
    x, z = (a.ravel() for a in np.meshgrid(u, u, indexing="ij"))
    height = y - (0.05 * size * np.cos(3 * x / size) ** 2 if cells > 1 else 0 * x)
    k = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = np.concatenate([np.stack([k, k + 1, k + cells + 1], 1), np.stack([k + 1, k + cells + 2, k + cells + 1], 1)])
    return trimesh.Trimesh(np.stack([x, height, z], axis=1), faces, process=False)


def slab_without_thickness():
    ground = plane(4.0)
    both = np.concatenate([ground.faces, ground.faces[:, ::-1]])
    return trimesh.Trimesh(ground.vertices, both, process=False)


def triangle(*points):
    return trimesh.Trimesh(points, [[0, 1, 2]], process=False)


def confetti():
    """A hundred small triangles about the object, some within its box."""
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(100, 1, 3)) * 5 + rng.normal(size=(100, 3, 3)) * 0.1
    beyond = np.abs(corners).max(axis=(1, 2)) > 1.01
    return trimesh.Trimesh(corners[beyond].reshape(-1, 3), np.arange(3 * beyond.sum()).reshape(-1, 3), process=False)


STRAY = {
    "a hundred triangles": confetti(),
    "ground plane": plane(5.0),
    "terrain": plane(5.0, y=-1.2, cells=40),
    "plane of two sides": slab_without_thickness(),
    "one triangle far away": triangle((9, 0, 0), (9.5, 0, 0), (9, 0.5, 0)),
    "one triangle very far away": triangle((9e5, 0, 0), (9e5 + 1, 0, 0), (9e5, 1, 0)),
    "a point": triangle((7, 7, 7), (7, 7, 7), (7, 7, 7)),
    "a line from the object": triangle(BALL.vertices[0], (8, 0, 0), (BALL.vertices[0] + (8, 0, 0)) / 2),
}  # fmt: skip


@pytest.mark.parametrize("what", STRAY)
def test_what_encloses_nothing_does_not_decide_the_size(tmp_path, what):
    """The ball has its size, its centre and its exact volume; what was left out is said."""
    both = trimesh.util.concatenate([BALL, STRAY[what]])
    particles = prepared(trimesh.Trimesh(both.vertices, both.faces, process=False), tmp_path / "scene.ply")
    assert particles.volume.sum() == pytest.approx(scaled(BALL.volume, BALL), rel=1e-4)
    assert np.allclose((particles.X.min(0) + particles.X.max(0)) / 2, 1.0, atol=0.05 * SPACING)
    note = next(n for n in particles.notes if "left out" in n)
    assert note.startswith(f"{len(STRAY[what].faces)} triangles")
    assert "asset.size" in note


def test_a_wall_in_the_box_of_the_object_stays(tmp_path):
    both = trimesh.util.concatenate([BALL, triangle((0.9, 0.9, 0.9), (0.95, 0.9, 0.9), (0.9, 0.95, 0.9))])
    assert not bodies.outliers(both.triangles).any()


def test_sides_that_enclose_something_together_stay():
    """A box of six separate squares beside a closed ball: each is flat, all together are a box."""
    box = trimesh.creation.box((2, 2, 2))
    facing = [(box.face_normals @ n > 0.9) for n in np.concatenate([np.eye(3), -np.eye(3)])]
    sides = [moved(trimesh.Trimesh(box.vertices, box.faces[k], process=False), 4, 0, 0) for k in facing]
    loose = trimesh.util.concatenate([BALL, *(moved(s, *(1e-3 * s.face_normals[0])) for s in sides)])
    assert not bodies.outliers(loose.triangles).any()


def test_an_object_of_open_parts_stays_whole():
    """A bowl of one layer and a cap that is not joined to it."""
    ball = trimesh.creation.icosphere(4)
    bowl, cap = ball.copy(), ball.copy()
    bowl.update_faces(ball.triangles_center[:, 1] < 0)
    cap.update_faces(ball.triangles_center[:, 1] > 0)
    assert not bodies.outliers(trimesh.util.concatenate([bowl, moved(cap, 0, 0.01, 0)]).triangles).any()
    assert not bodies.outliers(plane(1.0).triangles).any()


def inside_out(mesh):
    out = mesh.copy()
    out.invert()
    return out


@pytest.mark.parametrize("turned", [(False, True), (True, False), (True, True)])
def test_overlapping_bodies_count_once_whichever_is_inside_out(tmp_path, turned):
    """Two unit balls a radius apart share a lens of volume 5 pi / 12."""
    pair = [BALL, moved(BALL, 1, 0, 0)]
    both = trimesh.util.concatenate([inside_out(b) if t else b for b, t in zip(pair, turned, strict=True)])
    particles = prepared(trimesh.Trimesh(both.vertices, both.faces, process=False), tmp_path / "both.stl", SPACING / 2)
    union = (2 * 4 / 3 - 5 / 12) * np.pi * (BALL.volume / (4 / 3 * np.pi))
    # Volume by samples, and the polyhedra's lens is not quite that of the balls: 1 %.
    assert particles.volume.sum() == pytest.approx(scaled(union, both), rel=0.01)
    assert not any("exact" in note for note in particles.notes)
    assert any("overlap" in note for note in particles.notes)


@pytest.mark.parametrize("all_turned", [False, True])
def test_a_cavity_is_not_turned(tmp_path, all_turned):
    hole = BALL.copy()
    hole.apply_scale(0.6)
    shell = trimesh.util.concatenate([BALL, inside_out(hole), moved(inside_out(hole), 2.5, 0, 0)])
    shell = inside_out(shell) if all_turned else shell
    particles = prepared(shell, tmp_path / "shell.stl")
    scale = 0.6 / shell.extents.max()
    assert particles.volume.sum() == pytest.approx(BALL.volume * scale**3, rel=1e-4)
    r = np.linalg.norm(particles.X - [1 - scale * 1.05, 1, 1], axis=1)
    assert r.min() > 0.6 * scale * 0.98


def test_turning_takes_a_part_as_a_whole():
    soup = np.concatenate([BALL.triangles, moved(inside_out(BALL), 3, 0, 0).triangles, BALL.triangles[:, ::-1] * 0.5])
    mesh = weld.weld(soup)
    assert mesh.oriented
    assert mesh.volume == pytest.approx((1 + 1 - 1 / 8) * BALL.volume)
    assert np.sign(orient.volumes(soup, np.repeat([0, 1, 2], len(BALL.faces)))).tolist() == [1, -1, -1]


def dish(wall):
    """A hemispherical dish of outer radius 1."""
    angle = np.linspace(0, np.pi / 2, 30)
    arc = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    profile = np.concatenate([arc, (1 - wall) * arc[::-1]])
    return trimesh.creation.revolve(profile, sections=64)


@pytest.mark.parametrize("spacing", [0.01, 0.02, 0.03])
def test_a_shell_too_thin_for_the_particles_is_refused_with_the_way_out(tmp_path, spacing):
    with pytest.raises(ValueError, match=r"asset\.path=.*is a shell about 0\.0003 m thick.*Solidify") as error:
        prepared(dish(0.001), tmp_path / "dish.stl", spacing)
    assert "solver.cells" not in str(error.value)


def test_finer_cells_are_proposed_where_they_can_help(tmp_path):
    with pytest.raises(ValueError, match=r"solver\.cells to \d times as many"):
        prepared(dish(0.01), tmp_path / "dish.stl", 0.035)


def test_a_shell_of_one_layer_of_particles_is_none_too_thin(tmp_path):
    """Half a spacing thick: particles everywhere, the volume exact."""
    shell = dish(0.5 * SPACING / 0.3)
    particles = prepared(shell, tmp_path / "dish.stl")
    assert particles.volume.sum() == pytest.approx(scaled(shell.volume, shell), rel=1e-4)
    assert not any("too thin for it" in note for note in particles.notes)
