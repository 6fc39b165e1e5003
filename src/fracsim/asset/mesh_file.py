"""Mesh files: glTF by `fracsim.asset.gltf_scene`, OBJ, PLY and STL by trimesh."""

import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fracsim.asset import gltf_scene, obj, picture, ply_mesh
from fracsim.asset.surface import GREY, Piece, Surface, corner_normals, joined, srgb
from fracsim.records import Array

MOST_TRIANGLES = 5_000_000
Colours = tuple[Array, Array, Array, list[Array], bool]
"""Corner colours (T, 3, 3), texture coordinates (T, 3, 2), texture indices (T,), textures, and whether coloured."""
UNSET = (102, 102, 102, 255)
"""The diffuse colour that trimesh sets if the file gives none."""


def read(path: str) -> Surface:
    """The triangles of a mesh file; raises ValueError, with asset.path, for an unusable file."""
    readers = {".glb": gltf_scene.pieces, ".gltf": gltf_scene.pieces, ".obj": _obj_pieces}
    found, notes = readers.get(Path(path).suffix.lower(), _pieces)(path)
    if not found:
        raise ValueError(
            f"asset.path={path} has no triangles{' that are seen' * bool(notes)}: give a surface mesh; a trained 3DGS "
            f"file needs asset.kind=ply. {' '.join(notes)}".rstrip()
        )
    _check(path, found)
    return joined(found, notes)


def _pieces(path: str) -> tuple[list[Piece], tuple[str, ...]]:
    """The surfaces of a file that trimesh reads, and notes."""
    import trimesh

    if Path(path).suffix.lower() == ".ply" and _guarded(path, lambda: ply_mesh.is_one(path)):
        parts = [part for part in [_guarded(path, lambda: ply_mesh.read(path))] if len(part.faces)]
    else:
        parts = _guarded(path, lambda: _triangles(trimesh.load_scene(path, process=False)))
    return [_piece(part, _colours(part)) for part in parts], ()


def _obj_pieces(path: str) -> tuple[list[Piece], tuple[str, ...]]:
    """The surfaces of an OBJ file, and notes on what is missing; trimesh gets numbers for names of materials."""
    import trimesh

    file = Path(path)
    content = _guarded(path, lambda: obj.text(file))
    materials, notes = obj.materials(file, content)
    names: dict[str, str] = {}

    def number(line: re.Match[str]) -> str:
        return f"usemtl {names.setdefault(line[1].strip(), str(len(names)))}"

    content = re.sub(r"^[ \t]*usemtl[ \t]+(\S.*)$", number, content, flags=re.MULTILINE)
    content = "mtllib all\n" + re.sub(r"^[ \t]*mtllib.*$", "", content, flags=re.MULTILINE)
    stand_ins = {"all": "".join(f"newmtl {k}\nKd 1 1 1\n" for k in names.values()).encode()}
    stream = io.BytesIO(content.encode())
    parts = _guarded(
        path, lambda: _triangles(trimesh.load_scene(stream, file_type="obj", resolver=stand_ins, process=False))
    )
    by_number = {k: materials.get(name, obj.Material()) for name, k in names.items()}
    images = {k: _texture(file, m.map, notes) for k, m in by_number.items() if m.map}
    out = []
    for part in parts:
        k = str(getattr(getattr(part.visual, "material", None), "name", ""))
        plain = part.visual.kind != "texture"
        out.append(_piece(part, _colours(part) if plain else _obj_colours(part, by_number.get(k), images.get(k))))
    return out, tuple(notes)


def _texture(file: Path, name: str, notes: list[str]) -> Array | None:
    """The texture (H, W, 3) uint8 that an OBJ file names; None, with a note, if it is missing or no picture."""
    from PIL import Image

    found = obj.texture(file, name)
    try:
        if found is not None:
            return picture.rgb(Image.open(found))
        why = f"is missing: put it beside {file.name}. What it covers has the colour of its material."
    except OSError:
        why = "cannot be read as a picture. What it covers has the colour of its material."
    notes.append(f"The texture {name} {why}")
    return None


def _guarded(path: str, load: Callable[[], Any]) -> Any:
    """What `load` returns; raises ValueError, with asset.path, for whatever it raises."""
    try:
        return load()
    except Exception as error:  # each library raises a different kind for each format
        raise ValueError(
            f"asset.path={path} cannot be read as a mesh ({type(error).__name__}: {error}): export it again, as GLB."
        ) from error


def _triangles(scene: Any) -> list[Any]:
    """The geometries of a scene of trimesh that have triangles."""
    import trimesh

    return [g for g in scene.dump() if isinstance(g, trimesh.Trimesh) and len(g.faces)]


def _piece(part: Any, colours: Colours) -> Piece:
    """The triangles of one geometry of trimesh."""
    rgb, uv, index, images, coloured = colours
    normals = corner_normals(part.vertices, part.faces, part.vertex_normals)
    return Piece(
        corners=part.vertices[part.faces],
        normals=normals,
        rgb=rgb,
        uv=uv,
        texture=index,
        images=tuple(images),
        coloured=coloured,
        vertices=part.vertices,
        faces=part.faces,
    )


def _check(path: str, found: list[Piece]) -> None:
    """Raises ValueError for too many triangles and for coordinates that are not finite."""
    total = sum(len(p.faces) for p in found)
    if total > MOST_TRIANGLES:
        raise ValueError(
            f"asset.path={path} has {total} triangles, at most {MOST_TRIANGLES} are allowed: decimate the mesh."
        )
    bad = sum(int((~np.isfinite(p.vertices[np.unique(p.faces)])).any(axis=1).sum()) for p in found)
    if bad:
        raise ValueError(
            f"asset.path={path} has {bad} vertices with coordinates that are not finite (NaN or infinite): "
            "repair the mesh in the program that wrote it."
        )


def _colours(part: Any) -> Colours:
    """Of a geometry: corner colours (T, 3, 3), texture coordinates (T, 3, 2), texture indices (T,), textures (H, W, 3)
    each, and whether it had any colour.
    """
    n, visual = len(part.faces), part.visual
    rgb, uv, index = np.ones((n, 3, 3)), np.zeros((n, 3, 2)), np.full(n, -1)
    if visual.kind in ("vertex", "face"):
        picked = visual.vertex_colors[part.faces] if visual.kind == "vertex" else visual.face_colors[:, None]
        return rgb * _unit(picked)[..., :3], uv, index, [], True
    if visual.kind != "texture":
        return GREY * rgb, uv, index, [], False
    vertex = visual.vertex_attributes.get("color")
    painted = vertex is not None and len(vertex) == len(part.vertices)
    if painted:
        rgb *= _unit(vertex)[part.faces][..., :3]
    if visual.uv is not None and len(visual.uv) == len(part.vertices):
        uv = np.asarray(visual.uv, float)[part.faces]
    images = _materials(visual, rgb, index, painted)
    return rgb, uv, index, images, painted or bool(images) or bool((rgb != GREY).any())


def _obj_colours(part: Any, material: obj.Material | None, image: Array | None) -> Colours:
    """Colours of a geometry of an OBJ file, as `_colours`, of its own material and texture (H, W, 3).

    Kd is a display colour, and viewers use a texture instead of it.
    """
    n, visual, material = len(part.faces), part.visual, material or obj.Material()
    rgb, uv, index = np.ones((n, 3, 3)), np.zeros((n, 3, 2)), np.full(n, -1)
    vertex = visual.vertex_attributes.get("color")
    painted = vertex is not None and len(vertex) == len(part.vertices)
    if painted:
        rgb *= _unit(vertex)[part.faces][..., :3]
    if image is not None and visual.uv is not None and len(visual.uv) == len(part.vertices):
        uv = (np.asarray(visual.uv, float) * material.scale + material.offset)[part.faces]
        return rgb, uv, np.zeros(n, int), [image], True
    if material.kd is not None:
        rgb *= material.kd
    elif not painted:
        rgb *= GREY
    return rgb, uv, index, [], painted or material.kd is not None


def _materials(visual: Any, rgb: Array, index: Array, painted: bool) -> list[Array]:
    """Multiplies the factors of a geometry's materials into `rgb` (T, 3, 3) and sets the texture `index` (T,).

    Returns the textures, (H, W, 3) uint8 each.
    """
    images: list[Array] = []
    materials = getattr(visual.material, "materials", None) or [visual.material]
    owner = getattr(visual, "face_materials", None)
    owner = np.zeros(len(rgb), int) if owner is None or len(owner) != len(rgb) else np.asarray(owner)
    for k, material in enumerate(materials):
        mine = owner == k
        factor, image = _material(material)
        if image is not None and visual.uv is not None:
            index[mine] = len(images)
            images.append(image)
        elif factor is None and not painted:
            factor = np.full(3, GREY)
        rgb[mine] *= 1.0 if factor is None else factor
    return images


def _material(material: Any) -> tuple[Array | None, Array | None]:
    """Colour factor (3,), sRGB, and texture (H, W, 3) uint8 of a material, None for what it lacks."""
    if hasattr(material, "baseColorFactor"):  # physically based: factors are linear (glTF 2.0, 3.9.2)
        factor, image = material.baseColorFactor, material.baseColorTexture
        factor = None if factor is None else srgb(_unit(factor)[:3])
    else:  # Kd of an OBJ file is a display colour, and viewers use a map instead of it
        factor, image = _unit(material.diffuse)[:3], material.image
        if image is not None or np.array_equal(material.diffuse, UNSET):
            factor = None
    return factor, None if image is None else picture.rgb(image)


def _unit(values: Any) -> Array:
    """Colour values in [0, 1], of the shape of `values`, from integers of any width or from numbers in [0, 1]."""
    values = np.asarray(values)
    out: Array = values / np.iinfo(values.dtype).max if values.dtype.kind in "ui" else np.clip(values, 0.0, 1.0)
    return out
