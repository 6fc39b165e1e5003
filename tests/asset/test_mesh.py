"""Meshes: every format and colour, every kind of broken surface, and one real file."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fracsim.asset import gaussians, limits, mesh, paint, surface, weld
from fracsim.asset.nearest import Nearest
from fracsim.asset.rays import Rays
from fracsim.vocab import Asset

SPACING = 0.02
DUCK = Path(__file__).parents[2] / ".." / "shared" / "data" / "Duck.glb"
BALL = trimesh.creation.icosphere(3)


def prepared(thing, path, spacing=SPACING, **fields):
    if thing is not None:
        thing.export(path)
    return mesh.prepare(Asset(kind="mesh", path=str(path), **fields), spacing, 0)


def scaled(volume, thing):
    """The volume of a mesh at asset.size = 0.6."""
    return volume * (0.6 / thing.extents.max()) ** 3


def colours(particles):
    return 0.5 + gaussians.SH_C0 * particles.sh[:, 0]


def hues(particles):
    """Surface colours over their largest component: the light is divided out."""
    rgb = colours(particles)[particles.surface]
    return rgb / rgb.max(axis=1, keepdims=True)


def pieces(particles, reach):
    """Sizes of the groups of particles that are connected by steps of `reach`, largest first."""
    pairs = cKDTree(particles.X).query_pairs(reach, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(particles), len(particles)))
    return np.sort(np.bincount(connected_components(graph, directed=False)[1]))[::-1]


def solid_angle_winding(corners, P):
    """The generalized winding number by the solid angles of triangles (Van Oosterom and Strackee 1983): the oracle."""
    total = np.zeros(len(P))
    for a, b, c in corners:
        A, B, C = a - P, b - P, c - P
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (A, B, C))
        dot = la * lb * lc + (A * B).sum(1) * lc + (B * C).sum(1) * la + (C * A).sum(1) * lb
        total += 2 * np.arctan2(np.einsum("ij,ij->i", A, np.cross(B, C)), dot)
    return total / (4 * np.pi)


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


def test_srgb_of_a_linear_factor():
    """IEC 61966-2-1: 0.5 -> 0.7354, 0.001 -> 0.01292."""
    assert np.allclose(surface._srgb(np.array([0.0, 0.001, 0.5, 1.0])), [0, 0.01292, 0.73536, 1.0], atol=1e-5)


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
    placed = surface.read(str(DUCK)).corners
    placed = (placed - (placed.min((0, 1)) + placed.max((0, 1))) / 2) * 0.6 / np.ptp(placed, axis=(0, 1)).max() + 1
    some = np.random.default_rng(0).choice(len(particles), 300, replace=False)
    assert (solid_angle_winding(placed, particles.X[some].astype(float)) > 0.5).all()
    rgb = colours(particles)
    assert np.allclose(np.median(rgb[particles.surface], axis=0), (0.9, 0.8, 0.05), atol=0.12)
    black = particles.X[particles.surface & (rgb.max(axis=1) < 0.3)]
    assert len(black) > 5
    assert (black[:, 1] > 1.05).all()
