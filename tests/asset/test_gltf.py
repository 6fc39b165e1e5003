"""glTF: every way in which a file may say where its triangles are and what colour they have."""

import base64
import builtins
import json
import struct
from io import BytesIO

import numpy as np
import pytest
import trimesh
from PIL import Image

from fracsim.asset import gltf, gltf_scene, meshopt, surface

from .meshes import BALL, hues, prepared, scaled

TYPES = {"f4": 5126, "u1": 5121, "u2": 5123, "u4": 5125, "i1": 5120, "i2": 5122}
COLUMNS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
RED, GREEN, BLUE, WHITE = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)


class Writer:
    """A glTF document with one binary chunk."""

    def __init__(self):
        self.json = {"asset": {"version": "2.0"}, "buffers": [{"byteLength": 0}], "bufferViews": [], "accessors": [],
                     "meshes": [], "nodes": [], "scenes": [{"nodes": []}], "scene": 0}  # fmt: skip
        self.data = b""

    def view(self, content, **more):
        self.data += bytes(-len(self.data) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content), **more})
        self.data += content
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values, **more):
        values = np.asarray(values)
        values = values.reshape(len(values), -1)
        kind = {"componentType": TYPES[values.dtype.str[1:]], "count": len(values), "type": COLUMNS[values.shape[1]]}
        self.json["accessors"].append({"bufferView": self.view(values.tobytes()), **kind, **more})
        return len(self.json["accessors"]) - 1

    def mesh(self, mesh=BALL, material=None, mode=None, indices=None, **attributes):
        indices = mesh.faces.ravel() if indices is None else indices
        primitive = {"attributes": {"POSITION": self.accessor(mesh.vertices.astype("f4")), **attributes},
                     "indices": self.accessor(np.asarray(indices, "u4"))}  # fmt: skip
        if material is not None:
            self.json.setdefault("materials", []).append(material)
            primitive["material"] = len(self.json["materials"]) - 1
        if mode is not None:
            primitive["mode"] = mode
        self.json["meshes"].append({"primitives": [primitive]})
        return len(self.json["meshes"]) - 1

    def node(self, mesh=None, root=True, **fields):
        self.json["nodes"].append({**({} if mesh is None else {"mesh": mesh}), **fields})
        if root:
            self.json["scenes"][0]["nodes"].append(len(self.json["nodes"]) - 1)
        return len(self.json["nodes"]) - 1

    def picture(self, pixels):
        """A texture of colours (H, W, 3 or 4), rows from the top."""
        file = BytesIO()
        Image.fromarray(np.array(pixels, np.uint8)).save(file, "PNG")
        image = {"bufferView": self.view(file.getvalue()), "mimeType": "image/png"}
        self.json.setdefault("images", []).append(image)
        self.json.setdefault("textures", []).append({"source": len(self.json["images"]) - 1})
        return len(self.json["textures"]) - 1

    def save(self, path):
        self.json["buffers"][0]["byteLength"] = len(self.data)
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        data = self.data + bytes(-len(self.data) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        return path


def read(writer, tmp_path):
    """The surface of the document."""
    found, notes = gltf_scene.pieces(str(writer.save(tmp_path / "scene.glb")))
    return surface.joined(found, notes)


def constant(value):
    return np.tile(np.asarray(value), (len(BALL.vertices), 1))


def textured(index, **more):
    return {"pbrMetallicRoughness": {"baseColorTexture": {"index": index, **more}}}


def seen(read_, u=1 / 3):
    """Colours (T, 3) in the middle of the triangles, [0, 255]."""
    from fracsim.asset import paint

    middle = np.full((len(read_.corners), 3), u)
    return 255 * paint.sample(read_, np.arange(len(middle)), middle)


@pytest.mark.parametrize("kind", ["factor", "bytes", "shorts", "floats", "bytes with alpha", "factor times colour"])
def test_colours_are_linear(tmp_path, kind):
    """128, 55, 20 of 255 in linear light are 188, 128, 79 in sRGB (IEC 61966-2-1), as a factor and as COLOR_0."""
    w, linear = Writer(), np.array([128, 55, 20]) / 255
    if kind == "factor":
        mesh = w.mesh(material={"pbrMetallicRoughness": {"baseColorFactor": [*linear, 1.0]}})
    elif kind == "factor times colour":
        material = {"pbrMetallicRoughness": {"baseColorFactor": [*(2 * linear / (1, 1, 2)), 1.0]}}
        mesh = w.mesh(material=material, COLOR_0=w.accessor(constant((0.5, 0.5, 1)).astype("f4")))
    else:
        colours = {"bytes": (constant((128, 55, 20)).astype("u1"), True),
                   "bytes with alpha": (constant((128, 55, 20, 255)).astype("u1"), True),
                   "shorts": (constant((128 * 257, 55 * 257, 20 * 257)).astype("u2"), True),
                   "floats": (constant(linear).astype("f4"), False)}[kind]  # fmt: skip
        mesh = w.mesh(COLOR_0=w.accessor(colours[0], normalized=colours[1]))
    w.node(mesh)
    result = read(w, tmp_path)
    assert np.allclose(255 * result.rgb, (187.8, 128.0, 79.1), atol=0.5)
    assert not result.notes


def test_a_factor_and_a_texture_are_multiplied_in_linear_light(tmp_path):
    """0.2159 is 128 / 255 made linear: half of it is 92.4 in sRGB, not 128 times 0.735."""
    w = Writer()
    material = textured(w.picture([[(128, 128, 128)] * 2] * 2))
    material["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 1.0, 1.0, 1.0]
    w.node(w.mesh(material=material, TEXCOORD_0=w.accessor(constant((0.5, 0.5)).astype("f4"))))
    assert np.allclose(seen(read(w, tmp_path))[0], (92.4, 128, 128), atol=0.6)


QUARTERS = [[RED, GREEN], [BLUE, WHITE]]
"""Rows from the top, as glTF counts v."""


@pytest.mark.parametrize(
    ("transform", "at", "colour"),
    [
        ({}, (0.25, 0.25), RED),
        ({}, (0.75, 0.25), GREEN),
        ({}, (0.25, 0.75), BLUE),
        ({"offset": [0.5, 0]}, (0.25, 0.25), GREEN),
        ({"offset": [0, 0.5]}, (0.25, 0.25), BLUE),
        ({"scale": [3, 1]}, (0.25, 0.25), GREEN),
        ({"scale": [1, 3]}, (0.25, 0.25), BLUE),
        ({"offset": [0.5, 0], "scale": [3, 1]}, (0.25, 0.25), RED),
        # A quarter turn counter-clockwise, v downward: (u, v) -> (v, -u).
        ({"rotation": np.pi / 2}, (0.75, 0.25), RED),
        ({"rotation": np.pi / 2}, (0.25, 0.75), WHITE),
        # Scaled first: (0.75, 0.25) -> (0.75, 0.75) -> (0.75, -0.75).
        ({"rotation": np.pi / 2, "scale": [1, 3]}, (0.75, 0.25), GREEN),
        ({"texCoord": 1}, (0.75, 0.75), RED),
    ],
)
def test_texture_transform(tmp_path, transform, at, colour):
    w = Writer()
    w.json["extensionsUsed"] = ["KHR_texture_transform"]
    extra = {"extensions": {"KHR_texture_transform": transform}} if transform else {}
    material = textured(w.picture(np.repeat(np.repeat(QUARTERS, 8, 0), 8, 1)), **extra)
    uv = {
        "TEXCOORD_0": w.accessor(constant(at).astype("f4")),
        "TEXCOORD_1": w.accessor(constant((0.25, 0.25)).astype("f4")),
    }
    w.node(w.mesh(material=material, **uv))
    assert np.allclose(seen(read(w, tmp_path)), colour, atol=0.5)


def test_the_second_texture_coordinate(tmp_path):
    w = Writer()
    material = textured(w.picture(np.repeat(np.repeat(QUARTERS, 8, 0), 8, 1)), texCoord=1)
    uv = {f"TEXCOORD_{k}": w.accessor(constant(at).astype("f4")) for k, at in enumerate([(0.25, 0.25), (0.75, 0.25)])}
    mesh = w.mesh(material=material, **uv)
    w.node(mesh)
    assert np.allclose(seen(read(w, tmp_path)), GREEN, atol=0.5)
    del w.json["meshes"][mesh]["primitives"][0]["attributes"]["TEXCOORD_1"]
    assert any("TEXCOORD_1" in n and "missing" in n for n in read(w, tmp_path).notes)


@pytest.mark.parametrize(("dtype", "most"), [("u1", 255), ("u2", 65535), ("i1", 127), ("i2", 32767)])
def test_normalised_integers(tmp_path, dtype, most):
    """KHR_mesh_quantization: positions and texture coordinates as integers over their greatest."""
    w = Writer()
    w.json["extensionsUsed"] = w.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    material = textured(w.picture(np.repeat(np.repeat(QUARTERS, 8, 0), 8, 1)))
    uv = np.rint(constant((0.75, 0.25)) * most).astype(dtype)
    mesh = w.mesh(material=material, TEXCOORD_0=w.accessor(uv, normalized=True))
    low = 0.0 if dtype[0] == "u" else 0.5
    P = np.rint((BALL.vertices * (0.5 if low == 0 else 0.9) + (0.5 - low)) * most).astype(dtype)
    place = w.accessor(P, normalized=True)
    w.json["meshes"][mesh]["primitives"][0]["attributes"]["POSITION"] = place
    w.node(mesh)
    result = read(w, tmp_path)
    assert np.allclose(seen(result), GREEN, atol=1)
    assert np.ptp(result.corners, axis=(0, 1)).max() == pytest.approx(1.0 if low == 0 else 1.8, abs=2 / most)


@pytest.mark.parametrize("how", ["factor", "colour", "texture", "mask"])
def test_what_is_transparent_is_left_out(tmp_path, how):
    """A glass ball over a smaller red one: the red one is the object, and its size."""
    w, inner = Writer(), BALL.copy()
    inner.apply_scale(0.9)
    w.node(w.mesh(inner, material={"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}))
    glass, attributes = {"alphaMode": "BLEND", "pbrMetallicRoughness": {}}, {}
    if how == "factor":
        glass["pbrMetallicRoughness"]["baseColorFactor"] = [1, 1, 1, 0]
    elif how == "colour":
        attributes["COLOR_0"] = w.accessor(constant((1, 1, 1, 0)).astype("f4"))
    else:
        glass |= textured(w.picture([[(255, 255, 255, 0 if how == "texture" else 100)] * 2] * 2))
        attributes["TEXCOORD_0"] = w.accessor(constant((0.5, 0.5)).astype("f4"))
        glass["alphaMode"] = "BLEND" if how == "texture" else "MASK"
    w.node(w.mesh(material=glass, **attributes))
    particles = prepared(None, w.save(tmp_path / "glass.glb"))
    assert np.allclose(hues(particles), (1, 0, 0), atol=0.01)
    assert particles.volume.sum() == pytest.approx(scaled(BALL.volume, BALL), rel=1e-4)
    assert any(f"{len(BALL.faces)} triangles are transparent" in n for n in particles.notes)
    # An opaque material ignores alpha.
    glass["alphaMode"] = "OPAQUE"
    assert read(w, tmp_path).corners.max() == pytest.approx(1.0)


def test_half_transparent_is_opaque_and_said(tmp_path):
    w = Writer()
    w.node(w.mesh(material={"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 0.4]}}))
    result = read(w, tmp_path)
    assert np.allclose(result.rgb, (1, 0, 0))
    assert any("partly transparent" in n for n in result.notes)


def test_a_file_that_shows_nothing_says_why(tmp_path):
    w = Writer()
    w.node(w.mesh(material={"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0]}}))
    with pytest.raises(
        ValueError, match=r"asset\.path=.*has no triangles that are seen.*1280 triangles are transparent"
    ):
        prepared(None, w.save(tmp_path / "air.glb"))


def test_instances(tmp_path):
    """Three balls of one mesh: moved, turned by a normalised quaternion, scaled, in a node that is moved itself."""
    w = Writer()
    w.json["extensionsUsed"] = w.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    turn = np.array([[0, 0, 0, 127], [0, 90, 0, 90], [0, 0, 0, 127]], "i1")
    instancing = {"TRANSLATION": w.accessor(np.array([[0, 0, 0], [3, 0, 0], [0, 5, 0]], "f4")),
                  "ROTATION": w.accessor(turn, normalized=True),
                  "SCALE": w.accessor(np.array([[1, 1, 1], [1, 1, 0.5], [2, 2, 2]], "f4"))}  # fmt: skip
    w.node(w.mesh(), translation=[10, 0, 0], extensions={"EXT_mesh_gpu_instancing": {"attributes": instancing}})
    corners = read(w, tmp_path).corners.reshape(3, -1, 3)
    assert np.allclose(corners[0].mean(axis=0), (10, 0, 0), atol=0.01)
    # A quarter turn about y takes the flat axis from z to x.
    assert np.allclose(np.ptp(corners[1], axis=0), (1, 2, 2), atol=0.02)
    assert np.allclose([c.min(axis=0) for c in corners[1:]], [(12.5, -1, -1), (8, 3, -2)], atol=0.02)


def test_hidden_nodes_and_other_scenes_do_not_count(tmp_path):
    w = Writer()
    w.json["extensionsUsed"] = ["KHR_node_visibility"]
    mesh = w.mesh()
    w.node(mesh)
    hidden = {"KHR_node_visibility": {"visible": False}}
    child = w.node(mesh, root=False, translation=[9, 0, 0])
    w.node(mesh, translation=[0, 9, 0], extensions=hidden, children=[child])
    w.node(mesh, root=False, translation=[0, 0, 99])
    result = read(w, tmp_path)
    assert np.ptp(result.corners, axis=(0, 1)).max() == pytest.approx(2.0, abs=1e-6)
    assert "2 hidden nodes were left out." in result.notes
    assert any(n.startswith("1 meshes are in no scene") for n in result.notes)


def test_a_mirrored_node_keeps_its_outer_side(tmp_path):
    w = Writer()
    w.node(w.mesh(NORMAL=w.accessor(BALL.vertices.astype("f4"))), scale=[-1, 1, 1])
    result = read(w, tmp_path)
    a, b, c = result.corners.transpose(1, 0, 2)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(BALL.volume)
    assert np.allclose(result.normals, result.corners, atol=1e-3)


def test_normals_of_a_stretched_node(tmp_path):
    """Normals are transformed by the inverse transpose: on an ellipsoid they are P / radii^2."""
    w, radii = Writer(), np.array([3.0, 1.0, 0.5])
    w.node(w.mesh(NORMAL=w.accessor(BALL.vertices.astype("f4"))), scale=radii.tolist())
    result = read(w, tmp_path)
    expected = result.corners / radii**2
    smooth = np.abs(expected / np.linalg.norm(expected, axis=2, keepdims=True) - result.normals).max(axis=(1, 2)) < 1e-3
    assert smooth.mean() > 0.5  # the others are sharp at this stretch


@pytest.mark.parametrize(("mode", "indices"), [(5, [0, 1, 2, 3, 0, 1]), (6, [0, 1, 2, 3]), (4, [0, 1, 2, 0, 2, 3])])
def test_strips_and_fans(tmp_path, mode, indices):
    tetrahedron = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2]], process=False)
    w = Writer()
    w.node(w.mesh(tetrahedron, mode=mode, indices=indices))
    faces = {4: 2, 5: 4, 6: 2}[mode]
    result = read(w, tmp_path)
    assert len(result.corners) == faces
    assert result.watertight == (mode == 5)


def test_lines_and_points_are_left_out_and_said(tmp_path):
    w = Writer()
    w.node(w.mesh())
    w.node(w.mesh(mode=1), translation=[5, 0, 0])
    result = read(w, tmp_path)
    assert len(result.corners) == len(BALL.faces)
    assert "1 primitives are points or lines and were left out." in result.notes


def test_skins_are_in_the_pose_of_their_joints(tmp_path):
    """A rig in centimetres: the joint brings the vertices to metres, the node of the mesh counts for nothing."""
    w = Writer()
    n = len(BALL.vertices)
    mesh = w.mesh(
        JOINTS_0=w.accessor(np.zeros((n, 4), "u1")), WEIGHTS_0=w.accessor(constant((1, 0, 0, 0)).astype("f4"))
    )
    joint = w.node(scale=[0.01, 0.01, 0.01], translation=[0, 2, 0])
    bind = np.diag([50.0, 50, 50, 1]).astype("f4")
    w.json["skins"] = [{"joints": [joint], "inverseBindMatrices": w.accessor(bind.reshape(1, 16))}]
    w.node(mesh, skin=0, scale=[100, 100, 100])
    result = read(w, tmp_path)
    assert np.ptp(result.corners, axis=(0, 1)).max() == pytest.approx(1.0, abs=1e-5)
    assert np.allclose(result.corners.mean(axis=(0, 1)), (0, 2, 0), atol=0.01)


def test_morphs_and_sparse_arrays(tmp_path):
    """A target that moves 0.5 x up by half of its weight; one vertex is overwritten sparsely."""
    w = Writer()
    mesh = w.mesh()
    w.json["meshes"][mesh]["weights"] = [0.5]
    target = w.accessor(constant((0, 1, 0)).astype("f4"))
    primitive = w.json["meshes"][mesh]["primitives"][0]
    primitive["targets"] = [{"POSITION": target}]
    top = int(BALL.vertices[:, 1].argmax())
    w.json["accessors"][primitive["attributes"]["POSITION"]]["sparse"] = {
        "count": 1, "indices": {"bufferView": w.view(np.array([top], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": w.view(np.array([0, 7, 0], "<f4").tobytes())}}  # fmt: skip
    w.node(mesh)
    result = read(w, tmp_path)
    assert result.corners[..., 1].max() == pytest.approx(7.5)
    assert result.corners[..., 1].min() == pytest.approx(-0.5, abs=1e-6)


@pytest.mark.parametrize("name", ["KHR_gaussian_splatting", "ACME_shapes"])
def test_a_required_extension_that_is_not_read_is_named(tmp_path, name):
    w = Writer()
    w.node(w.mesh())
    w.json["extensionsUsed"] = w.json["extensionsRequired"] = [name, "KHR_texture_transform"]
    with pytest.raises(ValueError, match=rf"asset\.path=.*requires the glTF extension {name}, which is not read"):
        prepared(None, w.save(tmp_path / "odd.glb"))


def test_what_is_used_but_not_read_is_noted(tmp_path):
    w = Writer()
    w.node(
        w.mesh(_HEAT=w.accessor(constant((1.0,)).astype("f4")), COLOR_1=w.accessor(constant((1, 0, 0)).astype("f4")))
    )
    w.json["extensionsUsed"] = ["ACME_shapes", "KHR_materials_clearcoat"]
    notes = read(w, tmp_path).notes
    assert "Extensions of the file that are not read: ACME_shapes." in notes
    assert "Attributes of the file that are not read: COLOR_1, _HEAT." in notes


def test_a_texture_of_another_kind_is_noted(tmp_path):
    w = Writer()
    w.picture([[RED] * 2] * 2)
    w.json["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]
    w.node(w.mesh(material=textured(0), TEXCOORD_0=w.accessor(constant((0.5, 0.5)).astype("f4"))))
    assert any("of a kind that is not read" in n for n in read(w, tmp_path).notes)
    w.json["textures"], w.json["images"] = [{"source": 0}], [{"uri": "lost%20picture.png"}]
    assert any("lost%20picture.png is missing" in n for n in read(w, tmp_path).notes)


def test_specular_glossiness(tmp_path):
    w = Writer()
    w.json["extensionsUsed"] = ["KHR_materials_pbrSpecularGlossiness"]
    glossy = {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0, 1, 0, 1]}}
    w.node(w.mesh(material={"extensions": glossy}))
    assert np.allclose(read(w, tmp_path).rgb, (0, 1, 0))


def test_data_uris_and_files_with_blanks(tmp_path):
    w = Writer()
    w.node(w.mesh())
    w.json["buffers"] = [{"byteLength": len(w.data), "uri": "data:;base64," + base64.b64encode(w.data).decode()}]
    (tmp_path / "a.gltf").write_text(json.dumps(w.json))
    (tmp_path / "a b.bin").write_bytes(w.data)
    w.json["buffers"][0]["uri"] = "a%20b.bin"
    (tmp_path / "b.gltf").write_text(json.dumps(w.json))
    a, b = (gltf_scene.pieces(str(tmp_path / n))[0][0].corners for n in ("a.gltf", "b.gltf"))
    assert np.array_equal(a, b)
    (tmp_path / "a b.bin").unlink()
    with pytest.raises(ValueError, match=r"asset\.path=.*its buffer a%20b\.bin cannot be read"):
        gltf_scene.pieces(str(tmp_path / "b.gltf"))


@pytest.mark.parametrize("harm", ["accessor", "index", "loop", "json", "cut"])
def test_damaged_documents_are_refused(tmp_path, harm):
    w = Writer()
    w.node(w.mesh())
    if harm == "accessor":
        w.json["accessors"][0]["count"] = 10**6
    elif harm == "index":
        w.json["accessors"][0]["count"] = 5
    elif harm == "loop":
        w.json["nodes"][0]["children"] = [0]
    path = w.save(tmp_path / "bad.glb")
    if harm == "json":
        path.write_bytes(path.read_bytes().replace(b'"asset"', b'"asset'))
    elif harm == "cut":
        path.write_bytes(path.read_bytes()[:-5000])
    with pytest.raises(ValueError, match=r"asset\.path=.*bad\.glb cannot be read as glTF \("):
        prepared(None, path)


def draco(path):
    """A ball compressed by Draco, with colours."""
    import DracoPy

    w = Writer()
    colours = np.tile(np.array([128, 55, 20, 255], np.uint8), (len(BALL.vertices), 1))
    packed = DracoPy.encode(BALL.vertices.astype("f4"), BALL.faces.astype("u4"), colors=colours)
    mesh = w.mesh(COLOR_0=w.accessor(colours, normalized=True))
    primitive = w.json["meshes"][mesh]["primitives"][0]
    for accessor in w.json["accessors"]:
        del accessor["bufferView"]
    kinds = {a["attribute_type"]: a["unique_id"] for a in DracoPy.decode(packed).attributes}
    ids = {"POSITION": kinds[0], "COLOR_0": kinds[2]}
    primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": w.view(packed), "attributes": ids}}
    w.json["extensionsUsed"] = w.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    w.node(mesh)
    return w.save(path)


def test_draco(tmp_path):
    """14 bits a coordinate."""
    particles = prepared(None, draco(tmp_path / "ball.glb"))
    assert particles.volume.sum() == pytest.approx(scaled(BALL.volume, BALL), rel=1e-3)
    rgb = hues(particles)
    assert np.allclose(rgb, np.array([187.8, 128.0, 79.1]) / 187.8, atol=0.01)


def test_draco_without_its_library_names_it(tmp_path, monkeypatch):
    path, real = draco(tmp_path / "ball.glb"), builtins.__import__

    def without(name, *rest):
        if name == "DracoPy":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ValueError, match=r"asset\.path=.*KHR_draco_mesh_compression: `pip install DracoPy`"):
        prepared(None, path)


I = np.arange(20)
SHORTS = np.stack([100 * I, I * I, 7 + 0 * I, 65535 - 3 * I], axis=1).astype("<u2")
FLOATS = np.stack([np.sin(I / 3), np.cos(I / 3), I / 7, 0 * I + 2.5], axis=1).astype("<f4")
FACES = [[0, 4, 1], [1, 5, 2], [2, 6, 3], [4, 8, 5], [5, 9, 6], [6, 10, 7], [8, 12, 9], [9, 13, 10], [10, 14, 11],
         [4, 5, 1], [5, 6, 2], [6, 7, 3], [8, 9, 5], [9, 10, 6], [10, 11, 7], [12, 13, 9], [13, 14, 10], [14, 15, 11],
         [0, 9, 15], [3, 700, 12]]  # fmt: skip
STORED = {
    "v0": (
        "a00700c8c8c8c8c8c8c8c8c8c8c8c8c8c8c8ff000000c8c8c8c8050208822088000000070002060a0e12161a1e22262a2e32"
        "363aff0000003e42464a048000000000000a0555555555555555555500000000000000000000000000000000000000000000"
        "000000000000000000000000000700ffff"
    ),
    "v1": (
        "a1bb9a00c8c8c8c8c8c8c8c8c8c8c8c8c8c8c8c8c8c8c80002060a0e12161a1e22262a2e32363a3e42464a02055555555555"
        "55550f00050505050000000000000000000000000000000000000700ffff0100"
    ),
    "f1": (
        "a17f7f3faa0020d8509044ade2f640fae23c2cc5e396e481de00f3713acc0617aa06c4b95ed42c2f7d8b63168400b1ee7242"
        "0c2b5d9d4c6685825824134977f6830138004e007cff0c0001fe00996ab043d1fca8c27c51e67f429ae331fb4635002f8e44"
        "dd500e775573436a5b427f0c9525213f001d4f7dcca822b66634033b6bd3fcacf9784a1401007a0017fefd010002004a0024"
        "236d6d6d4a484a484a484a24262424240092004949dbdbdb929292929292924949494949002400926e484a4a242424262424"
        "2612121212120106007c0100000000000000000000803f000000000000204000000100"
    ),
    "tri": (
        "e1fefefefefefefefefefffffffffffffefefefffff0081f022f02f304f302f002f404f402f002cf1305cf0805cf0805b40a"
        "a3029f0205e3d30d710df506f20a007687566778a9866589689801690000"
    ),
    "seq": (
        "d100100a00100a00100a04100a00100a00100a04100a00100a00100a1a040e10040e10040e14040e10040e10040e14040e10"
        "040e10040e2a24182ef1152400000000"
    ),
    "OCTAHEDRAL": (
        "a00700f5f79c6b1653cdb943f11b63f043b5ff000000af5716950609792f47773f43771616ee00000005160700b27805f8b0"
        "9266707443556a3a7381ff000000778b89f90a0403938843978a43774a000000000000000000000000000000000000000000"
        "00000000000000000000000000ff070000ff07ff7f"
    ),
    "EXPONENTIAL": (
        "a0070078addb2cc0c10c811d9d102d7e3db7ff000000aa796f8a0a0a88401579b9731048aa00000000000005000004000200"
        "00000007003ee8243e9741c75bc84445c6ed628aff00000075819ec3060157999951046aaafc0000000a0804010010000200"
        "0700929292949292929292929492929292ff000000929294920a044464464446446444640000000000000000000000000000"
        "0000000000000000000000000000000000f4001000f4000000f4002800f4"
    ),
    "QUATERNION": (
        "a007004f2fd6c290d3d8b1a61519910d3857ff000000f2228bec07002c052d300037320841340e4734144dff000000321a51"
        "320700bc6581027e813cc8b39f18ad950a09ff000000563a652e070030551c344308383309361f1d380b31ff000000360843"
        "3407008ed27efdcd35aed16277aa66717509ff000000c24dd3dd0700240c372814412a184528204d2a2251ff0000002a2855"
        "280600430430430430433c000000040300000000000000000000000000000000000000000000000000000000000000fc1f"
    ),
    "COLOR": (
        "a00a057575575575557557550000000000000a0ceeceeceeceeceeecee000000000000070011151313131313131313131311"
        "1513ff0000001313131300000000000000000000000000000000000000000000000000000000008ce772ff"
    ),
}
"""The arrays above and those of the test of filters, compressed by meshoptimizer 1.0."""


def test_meshopt_vertices():
    for name in ("v0", "v1"):
        assert meshopt.decode(bytes.fromhex(STORED[name]), 20, 8, "ATTRIBUTES") == SHORTS.tobytes()
    assert meshopt.decode(bytes.fromhex(STORED["f1"]), 20, 16, "ATTRIBUTES") == FLOATS.tobytes()


def test_meshopt_indices():
    """Triangles may begin at another of their corners."""
    data = np.frombuffer(meshopt.decode(bytes.fromhex(STORED["tri"]), 60, 2, "TRIANGLES"), "<u2").reshape(-1, 3)
    expected = [min(np.roll(f, k).tolist() for k in range(3)) for f in FACES]
    assert [min(np.roll(f, k).tolist() for k in range(3)) for f in data] == expected
    sequence = np.frombuffer(meshopt.decode(bytes.fromhex(STORED["seq"]), 60, 4, "INDICES"), "<u4")
    assert sequence.tolist() == np.ravel(FACES).tolist()


def test_meshopt_filters():
    """Tolerances are half a step of the codes: 11 bits, 14 bits and a sign, 15 bits of mantissa, 8 bits."""
    c, s, one = np.cos(I), np.sin(I), 0 * I + 1.0
    stored = {name: bytes.fromhex(code) for name, code in STORED.items()}
    octahedral = np.frombuffer(meshopt.decode(stored["OCTAHEDRAL"], 20, 8, "ATTRIBUTES", "OCTAHEDRAL"), "<i2")
    assert np.allclose(octahedral.reshape(-1, 4)[:, :3] / 32767, np.stack([c, 0.6 * s, 0.8 * s], 1), atol=1e-3)
    turn = np.frombuffer(meshopt.decode(stored["QUATERNION"], 20, 8, "ATTRIBUTES", "QUATERNION"), "<i2")
    turn, expected = turn.reshape(-1, 4) / 32767, np.stack([c, 0.6 * s, 0.64 * s, 0.48 * s], 1)
    assert np.allclose(np.abs((turn * expected).sum(axis=1)), 1, atol=1e-3)
    numbers = np.frombuffer(meshopt.decode(stored["EXPONENTIAL"], 20, 16, "ATTRIBUTES", "EXPONENTIAL"), "<f4")
    assert np.allclose(numbers.reshape(-1, 4), FLOATS, atol=2e-4)
    colour = np.frombuffer(meshopt.decode(stored["COLOR"], 20, 4, "ATTRIBUTES", "COLOR"), "u1")
    assert np.allclose(colour.reshape(-1, 4) / 255, np.stack([I / 19, 1 - I / 19, 0.2 * one, one], 1), atol=0.012)


def test_meshopt_in_a_document(tmp_path):
    w = Writer()
    w.json["extensionsUsed"] = w.json["extensionsRequired"] = ["EXT_meshopt_compression", "KHR_mesh_quantization"]
    compressed = {"buffer": 0, "byteOffset": 0, "byteLength": len(STORED["v0"]) // 2, "byteStride": 8, "count": 20,
                  "mode": "ATTRIBUTES"}  # fmt: skip
    w.view(bytes.fromhex(STORED["v0"]))
    w.json["bufferViews"] = [{"buffer": 1, "byteLength": 160, "byteStride": 8,
                              "extensions": {"EXT_meshopt_compression": compressed}}]  # fmt: skip
    w.json["accessors"] = [{"bufferView": 0, "componentType": 5123, "count": 20, "type": "VEC3"}]
    assert np.array_equal(gltf.Document(str(w.save(tmp_path / "m.glb"))).array(0), SHORTS[:, :3])


def test_damaged_meshopt_data_is_refused():
    for mode in ("ATTRIBUTES", "TRIANGLES", "INDICES"):
        with pytest.raises(ValueError, match=f"damaged meshopt data of mode {mode}"):
            meshopt.decode(bytes.fromhex(STORED["v0"])[1:9], 20, 8, mode)
