"""Colours of glTF primitives: factor, texture and COLOR_0, all multiplied in linear light, and transparency."""

from typing import Any

import numpy as np

from fracsim.asset import picture
from fracsim.asset.gltf import Document
from fracsim.asset.surface import GREY, srgb
from fracsim.records import Array

INVISIBLE = 0.05
"""Triangles of less alpha than this everywhere are not drawn by viewers (alphaMode BLEND)."""
WEIGHTS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1 / 3, 1 / 3, 1 / 3]])
"""Places of a triangle where alpha is looked at: its corners and its middle."""


class Paint:
    """What a primitive looks like; T triangles."""

    def __init__(self, document: Document, primitive: dict[str, Any], arrays: dict[str, Array], faces: Array) -> None:
        """`arrays` are the attributes (V, columns) by name, `faces` (T, 3) their rows."""
        index = primitive.get("material")
        material = {} if index is None else document.items("materials")[index]
        factor, texture = _base(material)
        uv, self.image, alpha = _textured(document, texture, arrays, faces)
        colour = np.ones((len(faces), 3, 4))
        colour[..., : len(factor or ())] *= factor if factor is not None else 1.0
        if (painted := arrays.get("COLOR_0")) is not None:
            colour[..., : painted.shape[1]] *= painted[faces]
        self.coloured = factor is not None or painted is not None or self.image is not None
        self.rgb: Array = (
            srgb(np.clip(colour[..., :3], 0.0, 1.0)) if self.coloured else np.full((len(faces), 3, 3), GREY)
        )
        self.uv = uv
        mode = material.get("alphaMode", "OPAQUE")
        opacity = _opacity(colour[..., 3], uv, alpha)
        least = material.get("alphaCutoff", 0.5) if mode == "MASK" else INVISIBLE
        self.visible: Array = np.ones(len(faces), bool) if mode == "OPAQUE" else opacity.max(axis=1) >= least
        self.clear: Array = self.visible & (mode == "BLEND") & (opacity.min(axis=1) < 0.99)
        self.holes: Array = self.visible & (mode == "MASK") & (opacity.min(axis=1) < least)
        self.glows = any(material.get("emissiveFactor", ()))


def _base(material: dict[str, Any]) -> tuple[list[float] | None, dict[str, Any] | None]:
    """Factor (up to 4 numbers, linear) and texture of a material, None for what it does not give."""
    glossy = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
    if glossy is not None:
        return glossy.get("diffuseFactor"), glossy.get("diffuseTexture")
    rough = material.get("pbrMetallicRoughness", {})
    return rough.get("baseColorFactor"), rough.get("baseColorTexture")


def _textured(
    document: Document, texture: dict[str, Any] | None, arrays: dict[str, Array], faces: Array
) -> tuple[Array, Array | None, Array | None]:
    """Texture coordinates (T, 3, 2), origin below left, the picture (H, W, 3) uint8, and its alpha (H, W) in [0, 1].

    The coordinates are those that the texture names, transformed as it says.
    """
    nothing = np.zeros((len(faces), 3, 2)), None, None
    if texture is None:
        return nothing
    transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
    name = f"TEXCOORD_{transform.get('texCoord', texture.get('texCoord', 0))}"
    source = _source(document.items("textures")[texture["index"]])
    if source is None or name not in arrays:
        missing = (
            f"has coordinates {name}, which are missing" if source is not None else "is of a kind that is not read"
        )
        document.notes.append(f"A texture {missing}: what it covers has the colour of its material.")
        return nothing
    image = document.image(source)
    if image is None:
        return nothing
    (tx, ty), (sx, sy) = transform.get("offset", (0, 0)), transform.get("scale", (1, 1))
    c, s = np.cos(transform.get("rotation", 0.0)), np.sin(transform.get("rotation", 0.0))
    # Counter-clockwise in coordinates whose v points down; scaled first, moved last.
    u, v = sx * arrays[name][:, 0], sy * arrays[name][:, 1]
    uv = np.stack([c * u + s * v + tx, 1.0 - (-s * u + c * v + ty)], axis=1) if transform else _flipped(arrays[name])
    return uv[faces], picture.rgb(image), picture.alpha(image)


def _flipped(uv: Array) -> Array:
    """Coordinates (V, 2) with the origin below left."""
    return np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)


def _source(texture: dict[str, Any]) -> int | None:
    """The number of the picture of a texture; None if it has none that can be read."""
    extensions = texture.get("extensions", {})
    for name in ("EXT_texture_webp", "EXT_texture_avif"):
        if name in extensions:
            return int(extensions[name]["source"])
    return texture.get("source")


def _opacity(corner: Array, uv: Array, alpha: Array | None) -> Array:
    """Alpha (T, 4) at WEIGHTS of alpha at the corners (T, 3) times that of a picture (H, W) at `uv` (T, 3, 2)."""
    out: Array = corner @ WEIGHTS.T
    if alpha is not None:
        at = WEIGHTS @ uv
        height, width = alpha.shape
        column, row = (np.floor(at[..., 0] * width).astype(int), np.floor((1 - at[..., 1]) * height).astype(int))
        out = out * alpha[row % height, column % width]
    return out
