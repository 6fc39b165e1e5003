"""Meshes: every format and colour, files that are refused, and one real file."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from fracsim.asset import limits, mesh_file, paint, surface
from fracsim.scene.vocab import Asset

from .meshes import BALL, DUCK, SPACING, colours, hues, pieces, prepared, scaled, solid_angle_winding


@pytest.mark.parametrize("suffix", ["obj", "glb", "ply", "stl"])
def test_every_format_gives_the_volume_of_the_mesh(tmp_path, suffix):
    """A closed mesh has its exact volume, whatever the file does to its vertices."""
    particles = prepared(BALL, tmp_path / f"ball.{suffix}")
    assert particles.volume.sum() == pytest.approx(scaled(BALL.volume, BALL), rel=1e-4)
    assert np.allclose((particles.X.min(0) + particles.X.max(0)) / 2, 1.0, atol=0.05 * SPACING)
    # Surface particles lie a quarter of a spacing below the extent.
    assert np.ptp(particles.X, axis=0).max() == pytest.approx(0.6 - 0.5 * SPACING, abs=0.1 * SPACING)
    assert any("grey" in note for note in particles.notes)


def test_gltf_with_separate_files(tmp_path):
    scene = trimesh.Scene(BALL)
    for name, data in trimesh.exchange.gltf.export_gltf(scene).items():
        (tmp_path / name).write_bytes(data)
    particles = prepared(None, tmp_path / "model.gltf")
    assert particles.volume.sum() == pytest.approx(scaled(BALL.volume, BALL), rel=1e-4)


def test_vertex_colours(tmp_path):
    ball = BALL.copy()
    ball.visual.vertex_colors = np.where(ball.vertices[:, :1] > 0, (255, 0, 0, 255), (0, 0, 255, 255)).astype(np.uint8)
    for suffix in ("ply", "glb"):
        particles = prepared(ball, tmp_path / f"ball.{suffix}")
        x, hue = particles.X[particles.surface, 0] - 1, hues(particles)
        assert np.allclose(hue[x > 0.05], (1, 0, 0), atol=0.01)
        assert np.allclose(hue[x < -0.05], (0, 0, 1), atol=0.01)


def test_face_colours(tmp_path):
    box = trimesh.creation.box((1, 1, 1))
    box.visual.face_colors = np.where(box.face_normals[:, :1] > 0.5, (0, 255, 0, 255), (255, 255, 0, 255))
    particles = prepared(box, tmp_path / "box.ply")
    X, hue = particles.X[particles.surface] - 1, hues(particles)
    right = (X[:, 0] > 0.29) & (np.abs(X[:, 1:]).max(axis=1) < 0.25)
    left = X[:, 0] < 0.25
    assert right.any()
    assert np.allclose(hue[right], (0, 1, 0), atol=0.01)
    assert np.allclose(hue[left], (1, 1, 0), atol=0.01)


@pytest.mark.parametrize("suffix", ["glb", "obj"])
def test_texture_coordinates_are_interpolated(tmp_path, suffix):
    """A plate whose texture is red below left, green below right, blue above left, white above right."""
    picture = (
        np.array([[(0, 0, 255), (255, 255, 255)], [(255, 0, 0), (0, 255, 0)]], np.uint8).repeat(32, 0).repeat(32, 1)
    )
    box = trimesh.creation.box((1, 1, 0.2))
    image = Image.fromarray(picture)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image)
    if suffix == "obj":
        material = trimesh.visual.material.SimpleMaterial(image=image)
    box.visual = trimesh.visual.TextureVisuals(uv=box.vertices[:, :2] + 0.5, material=material)
    particles = prepared(box, tmp_path / f"plate.{suffix}")
    X, hue = particles.X[particles.surface] - 1, hues(particles)
    expected = {(-1, -1): (1, 0, 0), (1, -1): (0, 1, 0), (-1, 1): (0, 0, 1), (1, 1): (1, 1, 1)}
    for (sx, sy), colour in expected.items():
        here = (X[:, 0] * sx > 0.03) & (X[:, 1] * sy > 0.03) & (np.abs(X[:, :2]).max(axis=1) < 0.26)
        assert here.sum() > 20
        assert np.allclose(hue[here], colour, atol=0.02)


def test_materials_and_transforms_of_a_scene(tmp_path):
    """Three balls with a material each: a linear factor becomes sRGB, 0.5 -> 0.735; one has none and is grey."""
    scene = trimesh.Scene()
    for k, factor in enumerate(([255, 0, 0, 255], [128, 255, 128, 255], None)):
        ball = BALL.copy()
        if factor:
            material = trimesh.visual.material.PBRMaterial(baseColorFactor=factor)
            ball.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(ball.vertices), 2)), material=material)
        scene.add_geometry(ball, transform=trimesh.transformations.translation_matrix((2.5 * k, 0, 0)))
    particles = prepared(scene, tmp_path / "three.glb")
    X, hue = particles.X[particles.surface], hues(particles)
    third = 0.6 / 7 * 2.5
    assert np.allclose(hue[X[:, 0] < 1 - third / 2], (1, 0, 0), atol=0.01)
    assert np.allclose(hue[np.abs(X[:, 0] - 1) < third / 2], (0.735, 1, 0.735), atol=0.01)
    assert np.allclose(hue[X[:, 0] > 1 + third / 2], (1, 1, 1), atol=0.01)
    assert particles.volume.sum() == pytest.approx(3 * BALL.volume * (0.6 / 7) ** 3, rel=1e-4)
    assert len(pieces(particles, 1.5 * SPACING)) == 3


def test_obj_with_two_materials(tmp_path):
    (tmp_path / "two.mtl").write_text("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\n")
    lines = ["mtllib two.mtl"]
    for k, name in enumerate("ab"):
        box = trimesh.creation.box((1, 1, 1), trimesh.transformations.translation_matrix((2 * k, 0, 0)))
        lines += [f"v {x} {y} {z}" for x, y, z in box.vertices]
        lines += [f"usemtl {name}", *("f " + " ".join(str(i + 1 + 8 * k) for i in f) for f in box.faces)]
    (tmp_path / "two.obj").write_text("\n".join(lines))
    particles = prepared(None, tmp_path / "two.obj")
    left = particles.X[particles.surface, 0] < 1
    assert np.allclose(hues(particles)[left], (1, 0, 0), atol=0.01)
    assert np.allclose(hues(particles)[~left], (0, 0, 1), atol=0.01)


def test_the_light_is_gentle_and_from_above(tmp_path):
    particles = prepared(BALL, tmp_path / "ball.stl")
    value, y = colours(particles)[particles.surface].max(axis=1), particles.X[particles.surface, 1] - 1
    assert value[y > 0.2].mean() > value[y < -0.2].mean()
    assert np.ptp(value) < 0.5 * value.max()


def test_the_inside_has_its_own_colour_and_grain(tmp_path):
    ball = BALL.copy()
    ball.visual.vertex_colors = (200, 40, 40, 255)
    ball.export(tmp_path / "ball.ply")
    muted, given = (prepared(None, tmp_path / "ball.ply", interior=i) for i in ("", "#20c020"))
    deep = np.linalg.norm(given.X - 1, axis=1) < 0.3 - (paint.DEEP + 0.5) * SPACING
    base = np.array([0x20, 0xC0, 0x20]) / 255
    assert np.allclose(colours(given)[deep].mean(axis=0), base, atol=0.02)
    assert 0.01 < colours(given)[deep][:, 1].std() < 0.1
    red = np.array([200, 40, 40]) / 255
    inside = colours(muted)[deep].mean(axis=0)
    assert np.ptp(inside) < np.ptp(red)
    assert inside.mean() > red.mean()
    # The colour of the surface reaches down to where interior Gaussians might show through it.
    below = ~muted.surface & (np.linalg.norm(muted.X - 1, axis=1) > 0.3 - 0.95 * SPACING)
    rgb = colours(muted)[below]
    assert below.any()
    assert np.allclose(rgb / rgb[:, :1], (1, 0.2, 0.2), atol=0.01)


def test_srgb_of_a_linear_factor():
    """IEC 61966-2-1: 0.5 -> 0.7354, 0.001 -> 0.01292."""
    assert np.allclose(surface.srgb(np.array([0.0, 0.001, 0.5, 1.0])), [0, 0.01292, 0.73536, 1.0], atol=1e-5)


def test_a_sheet_is_refused(tmp_path):
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    with pytest.raises(ValueError, match=r"asset\.path=.*encloses no volume.*thickness"):
        prepared(sheet, tmp_path / "sheet.stl")


def test_vertices_that_are_not_finite_are_refused(tmp_path):
    (tmp_path / "bad.obj").write_text("v 0 0 0\nv 1 0 0\nv nan 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    with pytest.raises(ValueError, match=r"asset\.path=.*1 vertices.*not finite.*repair"):
        prepared(None, tmp_path / "bad.obj")


@pytest.mark.parametrize("text", ["", "v 0 0 0\nv 1 0 0\n", "no mesh at all"])
def test_files_without_triangles_are_refused(tmp_path, text):
    (tmp_path / "empty.obj").write_text(text)
    with pytest.raises(ValueError, match=r"asset\.path=.*empty\.obj"):
        prepared(None, tmp_path / "empty.obj")


def test_a_broken_file_is_refused(tmp_path):
    (tmp_path / "broken.glb").write_bytes(b"glTF" + bytes(100))
    with pytest.raises(ValueError, match=r"asset\.path=.*broken\.glb cannot be read"):
        prepared(None, tmp_path / "broken.glb")


def test_a_single_point_has_no_extent(tmp_path):
    (tmp_path / "point.obj").write_text("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n")
    with pytest.raises(ValueError, match=r"asset\.path=.*extent"):
        prepared(None, tmp_path / "point.obj")


@pytest.mark.parametrize("text", ["red", "#12345", "#gggggg"])
def test_interior_must_be_a_colour(text):
    with pytest.raises(ValueError, match=r"asset\.interior=.*#rrggbb"):
        limits.check(Asset(interior=text), SPACING)


@pytest.mark.skipif(not DUCK.is_file(), reason="needs the sample mesh ../shared/data/Duck.glb, which is not shipped")
def test_duck():
    """A real textured file with split vertices: closed after welding, its exact volume, yellow with a black eye."""
    particles = prepared(None, DUCK, spacing=0.012)
    duck = trimesh.load_scene(DUCK).to_mesh()
    assert particles.volume.sum() == pytest.approx(scaled(duck.volume, duck), rel=1e-4)
    assert any("welding" in note for note in particles.notes)
    assert len(pieces(particles, 1.6 * 0.012)) == 1
    # No particle outside: the oracle sees every one of them within the surface.
    placed = mesh_file.read(str(DUCK)).corners
    placed = (placed - (placed.min((0, 1)) + placed.max((0, 1))) / 2) * 0.6 / np.ptp(placed, axis=(0, 1)).max() + 1
    some = np.random.default_rng(0).choice(len(particles), 300, replace=False)
    assert (solid_angle_winding(placed, particles.X[some].astype(float)) > 0.5).all()
    rgb = colours(particles)
    assert np.allclose(np.median(rgb[particles.surface], axis=0), (0.9, 0.8, 0.05), atol=0.12)
    black = particles.X[particles.surface & (rgb.max(axis=1) < 0.3)]
    assert len(black) > 5
    assert (black[:, 1] > 1.05).all()
