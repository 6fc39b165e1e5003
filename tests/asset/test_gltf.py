"""glTF: every way in which a file may say what colour its triangles have."""

import numpy as np
import pytest

from .gltf_writer import BLUE, GREEN, RED, WHITE, Writer, constant, read, seen, textured
from .meshes import BALL, hues, prepared, scaled


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
