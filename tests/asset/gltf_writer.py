"""glTF documents for tests, written as a specification reads."""

import json
import struct
from io import BytesIO

import numpy as np
from PIL import Image

from fracsim.asset import gltf_scene, surface

from .meshes import BALL

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
