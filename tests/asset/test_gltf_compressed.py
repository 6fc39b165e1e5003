"""glTF: triangles compressed by Draco and meshopt."""

import builtins

import numpy as np
import pytest

from fracsim.asset import gltf, meshopt

from .gltf_writer import Writer
from .meshes import BALL, hues, prepared, scaled


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
