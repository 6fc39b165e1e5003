"""glTF: every way in which a file may say where its triangles are, and what is refused or noted."""

import base64
import json

import numpy as np
import pytest
import trimesh

from fracsim.asset import gltf_scene

from .gltf_writer import RED, Writer, constant, read, textured
from .meshes import BALL, prepared


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
