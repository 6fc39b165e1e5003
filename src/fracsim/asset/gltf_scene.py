"""Scenes of glTF files as coloured triangles: nodes, instances, skins and morphs in the pose that the file shows."""

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

from fracsim.asset.gltf import Document
from fracsim.asset.gltf_material import Paint
from fracsim.asset.surface import Piece, corner_normals
from fracsim.records import Array

KNOWN = ("POSITION", "NORMAL", "TANGENT", "TEXCOORD_", "COLOR_0", "JOINTS_", "WEIGHTS_")
"""Attributes that are read, or only concern shine."""
LEFT = {
    "hidden nodes": "hidden nodes were left out",
    "nodes elsewhere": "meshes are in no scene, or not in the one that the file shows, and were left out",
    "points or lines": "primitives are points or lines and were left out",
    "invisible triangles": "triangles are transparent and were left out",
    "glass": "triangles are partly transparent and are opaque here",
    "cut-outs": "triangles have holes by a mask of their texture, which are filled here",
    "glow": "primitives glow (emissiveFactor), which is not drawn",
}
"""What is counted, and the words after its number."""
DRACO = "KHR_draco_mesh_compression"


def pieces(path: str) -> tuple[list[Piece], tuple[str, ...]]:
    """The surfaces of the scene that the file shows, and notes; raises ValueError, with asset.path, if unusable."""
    try:
        scene = _Scene(Document(path))
        found = scene.pieces()
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, struct.error) as error:
        if str(error).startswith("asset."):
            raise
        raise ValueError(
            f"asset.path={path} cannot be read as glTF ({type(error).__name__}: {error}): export it again, as GLB."
        ) from error
    return found, scene.notes()


class _Scene:
    """The nodes of a document, and counts of what was left out."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.left = dict.fromkeys(LEFT, 0)
        self.attributes: set[str] = set()
        self.world: dict[int, Array] = {}

    def pieces(self) -> list[Piece]:
        """The surfaces of all visible nodes, in the order of the document."""
        document, found = self.document, []
        shown = dict(self._shown())
        nodes = document.items("nodes")
        self.left["nodes elsewhere"] = sum("mesh" in n for k, n in enumerate(nodes) if k not in self.world)
        for index, M in shown.items():
            node = nodes[index]
            if "mesh" not in node:
                continue
            mesh = document.items("meshes")[node["mesh"]]
            for primitive in mesh["primitives"]:
                piece = self._primitive(primitive, mesh, node)
                found += [_moved(piece, m) for m in self._instances(node, M)] if piece is not None else []
        return found

    def notes(self) -> tuple[str, ...]:
        """Notes for the user on what the file holds and the object does not show."""
        out = [f"{n} {LEFT[name]}." for name, n in self.left.items() if n]
        if self.attributes:
            out.append(f"Attributes of the file that are not read: {', '.join(sorted(self.attributes))}.")
        return (*dict.fromkeys(self.document.notes), *out)

    def _shown(self) -> Iterator[tuple[int, Array]]:
        """Index and matrix (4, 4) of each visible node of the scene that the file shows."""
        nodes, scenes = self.document.items("nodes"), self.document.items("scenes")
        children = {c for n in nodes for c in n.get("children", ())}
        roots = [k for k in range(len(nodes)) if k not in children]
        if scenes:
            roots = scenes[self.document.json.get("scene", 0)].get("nodes", [])
        todo = [(k, np.eye(4), True) for k in roots[::-1]]
        while todo:
            index, parent, seen = todo.pop()
            if index in self.world:
                raise ValueError(f"node {index} has two parents")
            node = nodes[index]
            self.world[index] = M = parent @ _matrix(node)
            seen = seen and node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True)
            self.left["hidden nodes"] += not seen and "mesh" in node
            todo += [(c, M, seen) for c in node.get("children", ())[::-1]]
            if seen:
                yield index, M

    def _instances(self, node: dict[str, Any], M: Array) -> list[Array]:
        """The matrices (4, 4) of the instances of a node; for a skin, which is in world coordinates, the identity."""
        if "skin" in node:
            return [np.eye(4)]
        instancing = node.get("extensions", {}).get("EXT_mesh_gpu_instancing")
        if instancing is None:
            return [M]
        arrays = {
            n.lower(): self.document.array(k) for n, k in instancing["attributes"].items() if not n.startswith("_")
        }
        count = len(next(iter(arrays.values())))
        return [M @ _matrix({name: a[i] for name, a in arrays.items()}) for i in range(count)]

    def _primitive(self, primitive: dict[str, Any], mesh: dict[str, Any], node: dict[str, Any]) -> Piece | None:
        """The triangles of a primitive in the coordinates of its node; None if it has none."""
        mode = primitive.get("mode", 4)
        if mode not in (4, 5, 6):
            self.left["points or lines"] += 1
            return None
        arrays, indices = _draco(self.document, primitive) or self._arrays(primitive)
        self.attributes |= {name for name in primitive["attributes"] if not name.startswith(KNOWN)}
        P = arrays["POSITION"]
        faces = _faces(mode, np.arange(len(P)) if indices is None else indices)
        if len(faces) and int(faces.max()) >= len(P):
            raise ValueError(f"index {int(faces.max())} of {len(P)} vertices")
        P, N = self._posed(primitive, mesh, node, arrays)
        paint = Paint(self.document, primitive, arrays, faces)
        for name, what in (("invisible triangles", ~paint.visible), ("glass", paint.clear), ("cut-outs", paint.holes)):
            self.left[name] += int(what.sum())
        self.left["glow"] += paint.glows
        seen = paint.visible
        if not seen.any():
            return None
        images = () if paint.image is None else (paint.image,)
        return Piece(
            corners=P[faces][seen],
            normals=corner_normals(P, faces, N)[seen],
            rgb=paint.rgb[seen],
            uv=paint.uv[seen],
            texture=np.full(int(seen.sum()), 0 if images else -1),
            images=images,
            coloured=paint.coloured,
            vertices=P,
            faces=faces[seen],
        )

    def _arrays(self, primitive: dict[str, Any]) -> tuple[dict[str, Array], Array | None]:
        """The attributes (V, columns) of a primitive by name, and its indices."""
        document, indices = self.document, primitive.get("indices")
        arrays = {name: document.array(k, not name.startswith("JOINTS")) for name, k in primitive["attributes"].items()
                  if name.startswith(KNOWN)}  # fmt: skip
        return arrays, None if indices is None else document.array(indices, numbers=False).ravel().astype(np.int64)

    def _posed(
        self, primitive: dict[str, Any], mesh: dict[str, Any], node: dict[str, Any], arrays: dict[str, Array]
    ) -> tuple[Array, Array | None]:
        """Positions (V, 3) and normals (V, 3) after morph targets and skin."""
        P, N = arrays["POSITION"], arrays.get("NORMAL")
        weights = node.get("weights", mesh.get("weights", ()))
        for weight, target in zip(weights, primitive.get("targets", ()), strict=False):
            if weight and "POSITION" in target:
                P = P + weight * self.document.array(target["POSITION"])
                N = None  # computed from the triangles
        if "skin" not in node or "JOINTS_0" not in arrays:
            return P, N
        skin = self.document.items("skins")[node["skin"]]
        joints = np.stack([self.world.get(j, np.eye(4)) for j in skin["joints"]])
        if "inverseBindMatrices" in skin:
            joints = joints @ self.document.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        total, M = np.zeros(len(P)), np.zeros((len(P), 4, 4))
        for k in range(len([n for n in arrays if n.startswith("JOINTS_")])):
            for joint, weight in zip(arrays[f"JOINTS_{k}"].T, arrays[f"WEIGHTS_{k}"].T, strict=True):
                M += weight[:, None, None] * joints[joint]
                total += weight
        M /= np.where(total > 0, total, 1.0)[:, None, None]
        M[total <= 0] = np.eye(4)
        return np.einsum("nij,nj->ni", M[:, :3, :3], P) + M[:, :3, 3], None


def _matrix(node: dict[str, Any]) -> Array:
    """The matrix (4, 4) of a node or instance: given, or translation times rotation (x y z w) times scale."""
    from scipy.spatial.transform import Rotation

    if "matrix" in node:
        return np.asarray(np.array(node["matrix"], float).reshape(4, 4).T)
    M: Array = np.eye(4)
    q = np.array(node.get("rotation", (0, 0, 0, 1)), float)
    if np.linalg.norm(q) > 0:
        M[:3, :3] = Rotation.from_quat(q).as_matrix()
    M[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), float)
    M[:3, 3] = node.get("translation", (0, 0, 0))
    return M


def _moved(piece: Piece, M: Array) -> Piece:
    """The piece under a matrix (4, 4); a mirrored one keeps its outer side."""
    A, shift = M[:3, :3], M[:3, 3]
    if np.array_equal(M, np.eye(4)):
        return piece
    cofactor = np.stack([np.cross(A[1], A[2]), np.cross(A[2], A[0]), np.cross(A[0], A[1])])
    normals = piece.normals @ cofactor.T
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-300)
    mirrored = np.linalg.det(A) < 0
    out = piece.with_shape(piece.corners @ A.T + shift, -normals if mirrored else normals, piece.vertices @ A.T + shift)
    return out.reversed() if mirrored else out


def _faces(mode: int, indices: Array) -> Array:
    """Triangles (T, 3) of indices (I,): one by one (4), a strip (5) or a fan (6)."""
    if mode == 4:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    if mode == 6:
        ends = np.stack([indices[1:-1], indices[2:]], axis=1)
        return np.concatenate([np.full((len(ends), 1), indices[0]), ends], axis=1)
    faces = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    faces[1::2] = faces[1::2][:, [0, 2, 1]]
    return faces


def _draco(document: Document, primitive: dict[str, Any]) -> tuple[dict[str, Array], Array] | None:
    """Attributes (V, columns) by name and indices of a primitive compressed by Draco; None for another one.

    Raises ValueError, with the way out, without the library that decodes it.
    """
    packed = primitive.get("extensions", {}).get(DRACO)
    if packed is None:
        return None
    try:
        import DracoPy
    except ImportError as error:
        raise ValueError(
            f"asset.path={document.path} is compressed by {DRACO}: `pip install DracoPy` (or `fracsim[meshes]`) to "
            "read it, or export it without compression."
        ) from error
    mesh = DracoPy.decode(document.view(packed["bufferView"]))
    by_id = {a["unique_id"]: a["data"] for a in mesh.attributes}
    arrays = {}
    for name, key in packed["attributes"].items():
        if not name.startswith(KNOWN):
            continue
        accessor = document.json["accessors"][primitive["attributes"][name]]
        values = np.asarray(by_id[key])
        values = values.reshape(len(mesh.points), -1)
        whole = accessor.get("normalized") and values.dtype.kind in "iu"
        arrays[name] = values / float(np.iinfo(values.dtype).max) if whole else values.astype(
            np.int64 if name.startswith("JOINTS") else np.float64)  # fmt: skip
    return arrays, np.asarray(mesh.faces, np.int64).ravel()
