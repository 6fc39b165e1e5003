"""Documents of glTF 2.0: the JSON, its buffers, and arrays out of them. What is not understood is never ignored.

Quantised, normalised, strided and sparse arrays become numbers as the specification says; buffer views compressed by
meshopt and primitives compressed by Draco are decoded.
"""

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from fracsim import sidefiles
from fracsim.asset import meshopt
from fracsim.records import Array

READ = {
    "KHR_texture_transform", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "KHR_draco_mesh_compression",
    "EXT_meshopt_compression", "KHR_meshopt_compression", "KHR_materials_pbrSpecularGlossiness", "KHR_node_visibility",
    "EXT_texture_webp", "EXT_texture_avif", "KHR_materials_unlit",
}  # fmt: skip
"""Extensions that are followed."""
SHINE = {
    "KHR_materials_clearcoat", "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_iridescence",
    "KHR_materials_sheen", "KHR_materials_specular", "KHR_materials_anisotropy", "KHR_materials_dispersion",
    "KHR_lights_punctual", "KHR_materials_diffuse_transmission", "KHR_materials_transmission", "KHR_materials_volume",
    "KHR_materials_variants", "KHR_xmp", "KHR_xmp_json_ld", "KHR_animation_pointer",
}  # fmt: skip
"""Extensions that change neither the shape nor the base colour: shine, light, glass, other variants."""
DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


class Document:
    """A file and what it refers to."""

    def __init__(self, path: str) -> None:
        """Raises ValueError, with asset.path, if the file is damaged or requires what is not understood."""
        self.path, self.folder = path, Path(path).parent
        content = Path(path).read_bytes()
        self.json, self._chunk = _parsed(content)
        self._views: dict[int, bytes] = {}
        required = set(self.json.get("extensionsRequired", ()))
        if unknown := sorted(required - READ - SHINE):
            hint = "; Gaussians in glTF need asset.kind=ply and a .ply" if "KHR_gaussian_splatting" in unknown else ""
            raise ValueError(
                f"asset.path={path} requires the glTF extension{'s' * (len(unknown) > 1)} {', '.join(unknown)}, which "
                f"{'are' if len(unknown) > 1 else 'is'} not read: export it without{hint}."
            )
        ignored = sorted(set(self.json.get("extensionsUsed", ())) - READ - SHINE)
        self.notes: list[str] = [f"Extensions of the file that are not read: {', '.join(ignored)}."] if ignored else []

    def items(self, name: str) -> list[Any]:
        """A list of the document, empty if there is none."""
        return list(self.json.get(name, ()))

    def view(self, index: int) -> bytes:
        """The bytes of a buffer view, decompressed."""
        if index not in self._views:
            view = self.json["bufferViews"][index]
            extensions = view.get("extensions", {})
            packed = extensions.get("EXT_meshopt_compression") or extensions.get("KHR_meshopt_compression")
            source = packed or view
            start = source.get("byteOffset", 0)
            data = self._buffer(source["buffer"])[start : start + source["byteLength"]]
            if len(data) < source["byteLength"]:
                raise ValueError(f"buffer view {index} ends after its buffer")
            if packed:
                kind = packed.get("filter", "NONE")
                data = meshopt.decode(data, packed["count"], packed["byteStride"], packed["mode"], kind)
            self._views[index] = data
        return self._views[index]

    def array(self, index: int, numbers: bool = True) -> Array:
        """The values of an accessor, (count, columns): float64, or integers as stored if not `numbers`."""
        accessor = self.json["accessors"][index]
        columns, dtype = COLUMNS[accessor["type"]], np.dtype(DTYPES[accessor["componentType"]])
        values = np.zeros((accessor["count"], columns), dtype)
        if "bufferView" in accessor:
            stride = self.json["bufferViews"][accessor["bufferView"]].get("byteStride", 0)
            start = accessor.get("byteOffset", 0)
            values = _strided(self.view(accessor["bufferView"]), start, stride, values)
        if sparse := accessor.get("sparse"):
            count, at, new = sparse["count"], sparse["indices"], sparse["values"]
            rows = np.zeros((count, 1), DTYPES[at["componentType"]])
            rows = _strided(self.view(at["bufferView"]), at.get("byteOffset", 0), 0, rows)
            values = values.copy()
            new = _strided(self.view(new["bufferView"]), new.get("byteOffset", 0), 0, np.zeros((count, columns), dtype))
            values[rows[:, 0]] = new
        if not numbers:
            return values
        if accessor.get("normalized") and dtype.kind in "iu":
            return np.maximum(values / float(np.iinfo(dtype).max), -1.0)
        return values.astype(np.float64)

    def image(self, index: int) -> Any:
        """A picture as Pillow opens it; None, with a note, if it is missing or of a kind that Pillow does not know."""
        import io

        from PIL import Image, UnidentifiedImageError

        image = self.json["images"][index]
        name = image.get("uri") or image.get("name") or f"number {index}"
        name = "in the file" if name.startswith("data:") else name
        try:
            data = self.view(image["bufferView"]) if "bufferView" in image else self._file(image["uri"])
            return Image.open(io.BytesIO(data))
        except (OSError, UnidentifiedImageError, KeyError) as error:
            why = "is missing" if isinstance(error, FileNotFoundError) else "cannot be read"
            self.notes.append(f"The texture {name} {why}: what it covers has the colour of its material.")
            return None

    def _buffer(self, index: int) -> bytes:
        """The bytes of a buffer."""
        uri = self.json["buffers"][index].get("uri")
        if uri is None:
            return self._chunk
        try:
            return self._file(uri)
        except OSError as error:
            raise ValueError(f"its buffer {uri} cannot be read; keep it beside the file, or export as .glb") from error

    def _file(self, uri: str) -> bytes:
        """The bytes of a file beside the document, or of a data URI."""
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        return sidefiles.of_uri(self.folder, uri).read_bytes()


def _parsed(content: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON of a .gltf or .glb file, and the binary chunk of the latter."""
    chunks: dict[bytes, bytes] = {}
    if content[:4] == b"glTF":
        version, at = struct.unpack_from("<I", content, 4)[0], 12
        if version != 2:
            raise ValueError(f"version {version} of glTF, 2 is read")
        while at + 8 <= len(content):
            size, kind = struct.unpack_from("<I4s", content, at)
            chunks.setdefault(kind, content[at + 8 : at + 8 + size])
            at += 8 + size
        content = chunks.get(b"JSON", b"")
    document = json.loads(content.decode("utf-8-sig"))
    if not isinstance(document, dict):
        raise ValueError("the file holds no glTF document")
    return document, chunks.get(b"BIN\0", b"")


def _strided(data: bytes, start: int, stride: int, like: Array) -> Array:
    """Values of the shape (count, columns) and type of `like`, whose rows lie `stride` bytes apart, 0 for close."""
    row = like.itemsize * like.shape[1]
    stride = stride or row
    need = start + stride * (len(like) - 1) + row if len(like) else 0
    if need > len(data):
        raise ValueError("an accessor ends after its buffer view")
    out: Array = np.ndarray(like.shape, like.dtype, data, start, (stride, like.itemsize))
    return out
