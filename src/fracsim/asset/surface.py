"""Coloured triangles of an OBJ, GLB, glTF, PLY or STL file, read by trimesh.

Colours are kept at the corners of each triangle (texture coordinates, vertex or face colours, material factors). So
shared vertices may have several colours, and several materials of a scene form one surface.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fracsim.records import Array

MOST_TRIANGLES = 5_000_000
GREY = 0.6
"""Colour, sRGB, of triangles without one."""
UNSET = (102, 102, 102, 255)
"""The diffuse colour that trimesh sets if the file gives none."""
SHARP = 0.7
"""An edge is sharp if the cosine between its face and vertex normals is below this."""


@dataclass(frozen=True)
class Surface:
    """T coloured triangles; corner c of triangle t is [t, c]."""

    corners: Array
    """Positions, (T, 3, 3)."""
    normals: Array
    """Unit shading normals at the corners, (T, 3, 3), outward if the file's are."""
    rgb: Array
    """Colours at the corners, sRGB in [0, 1]; they multiply the texture, (T, 3, 3)."""
    uv: Array
    """Texture coordinates at the corners, origin below left, (T, 3, 2)."""
    texture: Array
    """Index into `images`, -1 for no texture, (T,)."""
    images: tuple[Array, ...]
    """Textures, rows from the top, (H, W, 3) uint8, sRGB."""
    watertight: bool
    """Whether every edge of the file has a partner, without welding of vertices."""
    notes: tuple[str, ...] = ()
    """Notes for the user about the file."""

    def some(self, kept: Array) -> "Surface":
        """The triangles with `kept`, (T,) bool."""
        per_triangle = ("corners", "normals", "rgb", "uv", "texture")
        return replace(self, **{name: getattr(self, name)[kept] for name in per_triangle})


def read(path: str) -> Surface:
    """The triangles of a mesh file; raises ValueError, with asset.path, for an unusable file."""
    import trimesh

    try:
        scene = trimesh.load_scene(path, process=False)
        parts = [g for g in scene.dump() if isinstance(g, trimesh.Trimesh) and len(g.faces)]
    except Exception as error:  # trimesh raises a different kind for each format
        raise ValueError(
            f"asset.path={path} cannot be read as a mesh ({type(error).__name__}: {error}): export it again, as GLB."
        ) from error
    if not parts:
        raise ValueError(
            f"asset.path={path} has no triangles: give a surface mesh; a trained 3DGS file needs asset.kind=ply."
        )
    _check_parts(path, parts)
    return _joined(parts)


def _check_parts(path: str, parts: list[Any]) -> None:
    """Raises ValueError for too many triangles and for coordinates that are not finite."""
    total = sum(len(p.faces) for p in parts)
    if total > MOST_TRIANGLES:
        raise ValueError(
            f"asset.path={path} has {total} triangles, at most {MOST_TRIANGLES} are allowed: decimate the mesh."
        )
    bad = sum(int((~np.isfinite(p.vertices[np.unique(p.faces)])).any(axis=1).sum()) for p in parts)
    if bad:
        raise ValueError(
            f"asset.path={path} has {bad} vertices with coordinates that are not finite (NaN or infinite): "
            "repair the mesh in the program that wrote it."
        )


def _joined(parts: list[Any]) -> Surface:
    """One surface of all geometries of a scene."""
    corners, normals, rgb, uv, texture = [], [], [], [], []
    images: list[Array] = []
    plain = 0
    for part in parts:
        corners.append(part.vertices[part.faces])
        normals.append(_corner_normals(part))
        c, t, index, pictures, coloured = _colours(part)
        rgb.append(c)
        uv.append(t)
        texture.append(np.where(index >= 0, index + len(images), -1))
        images.extend(pictures)
        plain += 0 if coloured else len(part.faces)
    notes = (f"{plain} triangles have no colour and are grey.",) if plain else ()
    watertight = all(p.is_watertight for p in parts)
    P, N, c, t, k = (np.concatenate(a) for a in (corners, normals, rgb, uv, texture))
    return Surface(P, N, c, t, k, tuple(images), watertight, notes)


def _corner_normals(part: Any) -> Array:
    """Normals at the corners, (T, 3, 3): vertex normals, or the face's own at sharp edges, as those of a box."""
    vertex, face = part.vertex_normals[part.faces], _face_normals(part)
    sharp = np.einsum("tcj,tj->tc", vertex, face) < SHARP
    out: Array = np.where(sharp[..., None], face[:, None, :], vertex)
    return out


def _face_normals(part: Any) -> Array:
    """Unit normals (T, 3), zero for triangles of no area."""
    a, b, c = part.vertices[part.faces].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    out: Array = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    return out


def _colours(part: Any) -> tuple[Array, Array, Array, list[Array], bool]:
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
        factor = None if factor is None else _srgb(_unit(factor)[:3])
    else:  # Kd of an OBJ file is a display colour, and viewers use a map instead of it
        factor, image = _unit(material.diffuse)[:3], material.image
        if image is not None or np.array_equal(material.diffuse, UNSET):
            factor = None
    return factor, None if image is None else np.asarray(image.convert("RGB"))


def _unit(values: Any) -> Array:
    """Colour values in [0, 1], of the shape of `values`, from integers of any width or from numbers in [0, 1]."""
    values = np.asarray(values)
    out: Array = values / np.iinfo(values.dtype).max if values.dtype.kind in "ui" else np.clip(values, 0.0, 1.0)
    return out


def _srgb(linear: Array) -> Array:
    """Display values, (3,), of linear intensities (3,) (IEC 61966-2-1)."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
