"""OBJ and PLY files as writers write them: missing and renamed files, options, other ways to count and to colour."""

import itertools

import numpy as np
import plyfile
import pytest
import trimesh
from PIL import Image

from fracsim import sidefiles
from fracsim.asset import cache, mesh_file, paint
from fracsim.scene.vocab import Asset

from .meshes import BALL, prepared

BOX = trimesh.creation.box((1, 1, 1))


SKIN = "newmtl skin\nKd 1 1 1\n"


def box(folder, mtl="toy.mtl", use="skin", material=SKIN, written="toy.mtl"):
    """A cube with one texture coordinate and one material."""
    name = "toy.obj"
    lines = [f"mtllib {mtl}", *(f"v {x} {y} {z}" for x, y, z in BOX.vertices), "vt 0.25 0.75", f"usemtl {use}",
             *("f " + " ".join(f"{i + 1}/1" for i in face) for face in BOX.faces)]  # fmt: skip
    (folder / name).write_text("\n".join(lines), encoding="utf-8")
    if written:
        (folder / written).write_text(material, encoding="utf-8")
    return folder / name


def quarters(path):
    """Red, green over blue, white."""
    pixels = np.array([[(255, 0, 0), (0, 255, 0)], [(0, 0, 255), (255, 255, 255)]], np.uint8)
    Image.fromarray(pixels.repeat(8, 0).repeat(8, 1)).save(path)


def colour(path):
    """The colour of the first triangle, and the notes."""
    read = mesh_file.read(str(path))
    return paint.sample(read, np.zeros(1, int), np.full((1, 3), 1 / 3))[0], read.notes


@pytest.mark.parametrize(
    ("line", "at"),
    [
        ("map_Kd skin.png", (1, 0, 0)),
        ("map_kd skin.png", (1, 0, 0)),
        ("\tmap_Kd\tskin.png", (1, 0, 0)),
        ("map_Kd C:\\Users\\me\\Textures\\skin.png", (1, 0, 0)),
        ("map_Kd textures\\skin.png", (1, 0, 0)),
        ("map_Kd /home/me/skin.png", (1, 0, 0)),
        ("map_Kd SKIN.PNG", (1, 0, 0)),
        ("map_Kd -s 1 1 1 -o 0 0 0 skin.png", (1, 0, 0)),
        ("map_Kd -bm 0.5 -blendu on -clamp off -mm 0 1 -imfchan l -texres 64 skin.png", (1, 0, 0)),
        ("map_Kd -s 3 1 1 skin.png", (0, 1, 0)),
        ("map_Kd -s 3 skin.png", (0, 1, 0)),
        ("map_Kd -o 0.5 skin.png", (0, 1, 0)),
        ("map_Kd -o 0 0.5 skin.png", (0, 0, 1)),
        # u = 0.75, v = 2.25 - 0.5 = 1.75: the upper right quarter.
        ("map_Kd -s 3 3 -o 0.0 -0.5 skin.png", (0, 1, 0)),
    ],
)
def test_textures_are_found_as_they_were_meant(tmp_path, line, at):
    quarters(tmp_path / "skin.png")
    found, notes = colour(box(tmp_path, material=f"newmtl skin\nKd 0.2 0.2 0.2\n{line}\n"))
    assert np.allclose(found, at, atol=0.01)
    assert not notes


def test_names_with_blanks_and_numbers(tmp_path):
    quarters(tmp_path / "2 my skin 3.png")
    material = "newmtl my skin\nKd 1 1 1\nmap_Kd -s 1 1 1 2 my skin 3.png\n"
    found, notes = colour(box(tmp_path, "my toy.mtl", use="my skin", material=material, written="my toy.mtl"))
    assert np.allclose(found, (1, 0, 0), atol=0.01)
    assert not notes


def test_several_material_files_and_other_letters(tmp_path):
    (tmp_path / "other.mtl").write_text("newmtl other\nKd 0 1 0\n")
    found, notes = colour(box(tmp_path, "other.mtl TOY.MTL", material="newmtl skin\r\nKd 0 0 1\r\n"))
    assert np.allclose(found, (0, 0, 1))
    assert not notes


def test_a_material_file_in_another_encoding(tmp_path):
    path = box(tmp_path, use="Gr\u00fcn")
    (tmp_path / "toy.mtl").write_bytes("newmtl Gr\u00fcn\nKd 0 1 0\n".encode("latin-1"))
    path.write_bytes(path.read_bytes().decode().encode("latin-1"))
    assert np.allclose(colour(path)[0], (0, 1, 0))


def test_a_missing_material_file_is_said_once(tmp_path):
    found, notes = colour(box(tmp_path, mtl="nowhere.mtl", written=""))
    assert np.allclose(found, 0.6)
    assert sum("nowhere.mtl" in n for n in notes) == 1
    assert any("nowhere.mtl is missing" in n and "grey" in n for n in notes)


def test_a_material_without_a_definition_is_said(tmp_path):
    found, notes = colour(box(tmp_path, use="lost"))
    assert np.allclose(found, 0.6)
    assert any("No material file defines lost" in n for n in notes)


@pytest.mark.parametrize("there", [False, True])
def test_a_missing_or_broken_texture_is_said_and_leaves_the_colour(tmp_path, there):
    if there:
        (tmp_path / "skin.png").write_text("no picture")
    found, notes = colour(box(tmp_path, material="newmtl skin\nKd 1 0 0\nmap_Kd skin.png\n"))
    assert np.allclose(found, (1, 0, 0))
    assert sum("skin.png" in n for n in notes) == 1
    assert any(f"The texture skin.png {'cannot be read' if there else 'is missing'}" in n for n in notes)


def test_the_key_of_the_cache_follows_the_files_that_are_found(tmp_path):
    path = box(tmp_path, mtl="sub\\TOY.mtl", material="newmtl skin\nmap_Kd -s 2 2 2 D:\\a b.png\n")
    quarters(tmp_path / "a b.png")
    assert [file for _, file in sidefiles.named(path)] == [tmp_path / "toy.mtl", tmp_path / "a b.png"]
    before = cache.key(Asset(kind="mesh", path=str(path)), 0.02, 0)
    Image.new("RGB", (4, 4)).save(tmp_path / "a b.png")
    assert cache.key(Asset(kind="mesh", path=str(path)), 0.02, 0) != before


@pytest.mark.parametrize("form", ["{0}", "{0}/{1}", "{0}//{2}", "{0}/{1}/{2}"])
def test_indices_from_the_end_count_what_came_before(tmp_path, form):
    """Two cubes, each face right after its vertices; without their places they would be one."""
    lines = ["# two", "o first"]
    for k in range(2):
        lines += [f"v {x + 3 * k} {y} {z}" for x, y, z in BOX.vertices] + ["vt 0 0", "vn 0 1 0"]
        lines += ["f " + " ".join(form.format(i - 8, -1, -1) for i in face) for face in BOX.faces] + ["o second"]
    (tmp_path / "two.obj").write_text("\n".join(lines))
    particles = prepared(None, tmp_path / "two.obj")
    assert particles.volume.sum() == pytest.approx(2 * (0.6 / 4) ** 3, rel=1e-4)


def test_lines_that_go_on(tmp_path):
    lines = [f"v {x} {y} \\\n {z}" for x, y, z in BOX.vertices]
    lines += ["f {} \\\n{} {}".format(*(i + 1 for i in face)) for face in BOX.faces]
    (tmp_path / "box.obj").write_bytes("\r\n".join(lines).replace("\\\n", "\\\r\n").encode())
    assert prepared(None, tmp_path / "box.obj").volume.sum() == pytest.approx(0.6**3, rel=1e-4)


def test_polygons_and_several_objects(tmp_path):
    """Quads of two objects, in one file."""
    quads = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines = []
    for k in range(2):
        lines += [f"o part{k}"] + [f"v {3 * k + x} {y} {z}" for x, y, z in itertools.product((0, 1), repeat=3)]
        lines += ["f " + " ".join(str(i + 8 * k) for i in q) for q in quads]
    (tmp_path / "two.obj").write_text("\n".join(lines))
    particles = prepared(None, tmp_path / "two.obj")
    assert particles.volume.sum() == pytest.approx(2 * (0.6 / 4) ** 3, rel=1e-4)


@pytest.mark.parametrize(
    ("dtype", "value"),
    [("u1", (255, 128, 0)), ("u2", (65535, 32896, 0)), ("f4", (1.0, 0.50196, 0.0)), ("f4", (255.0, 128.0, 0.0)),
     ("f8", (255.0, 128.0, 0.0)), ("i4", (255, 128, 0))],
)  # fmt: skip
def test_colours_of_any_width(tmp_path, dtype, value):
    names = [*((n, "f4") for n in "xyz"), *((n, dtype) for n in ("red", "green", "blue"))]
    vertex = np.array([(*P, *value) for P in BALL.vertices], names)
    face = np.array([(f,) for f in BALL.faces], [("vertex_indices", "i4", (3,))])
    elements = [plyfile.PlyElement.describe(vertex, "vertex"), plyfile.PlyElement.describe(face, "face")]
    plyfile.PlyData(elements).write(str(tmp_path / "ball.ply"))
    assert np.allclose(colour(tmp_path / "ball.ply")[0], (1, 128 / 255, 0), atol=0.003)


def strips(path, rows, text):
    vertex = np.array([tuple(P) for P in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))], [(n, "f4") for n in "xyz"])
    table = np.empty(len(rows), [("vertex_indices", "O")])
    table["vertex_indices"] = [np.array(r, "i4") for r in rows]
    element = plyfile.PlyElement.describe(table, "tristrips", len_types={"vertex_indices": "i4"})
    plyfile.PlyData([plyfile.PlyElement.describe(vertex, "vertex"), element], text=text).write(str(path))


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("rows", [[[0, 1, 2, 3, 0, 1]], [[2, 1, 0, 3, -1, 1, 2, 3, 0]]])
def test_triangle_strips(tmp_path, rows, text):
    """A tetrahedron of volume 1/6 in a strip, or in two that -1 separates."""
    strips(tmp_path / "tetra.ply", rows, text)
    particles = prepared(None, tmp_path / "tetra.ply")
    assert particles.volume.sum() == pytest.approx(0.6**3 / 6, rel=1e-4)


def test_a_texture_of_sixteen_bits_is_scaled(tmp_path):
    """A grey level of 32896 of 65535 is 128 of 255; clipped it would be white."""
    Image.fromarray(np.full((4, 4), 32896, np.uint16)).save(tmp_path / "skin.png")
    found, _ = colour(box(tmp_path, material="newmtl skin\nmap_Kd skin.png\n"))
    assert np.allclose(found, 128 / 255, atol=0.003)


def test_vertex_colours_of_obj(tmp_path):
    lines = [f"v {x} {y} {z} 1 0 0.5" for x, y, z in BALL.vertices]
    lines += ["f {} {} {}".format(*(i + 1 for i in face)) for face in BALL.faces]
    (tmp_path / "ball.obj").write_text("\n".join(lines))
    assert np.allclose(colour(tmp_path / "ball.obj")[0], (1, 0, 0.5), atol=0.003)
