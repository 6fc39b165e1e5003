"""Coloured triangles: what files of meshes become.

Colours are kept at the corners of each triangle (texture coordinates, vertex or face colours, material factors). So
shared vertices may have several colours, and several materials of a scene form one surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fracsim.records import Array

GREY = 0.6
"""Colour, sRGB, of triangles without one."""
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


@dataclass(frozen=True)
class Piece:
    """T triangles of one geometry of a file, with fields as in `Surface`."""

    corners: Array
    normals: Array
    rgb: Array
    uv: Array
    texture: Array
    images: tuple[Array, ...]
    coloured: bool
    """Whether the file gives it a colour."""
    vertices: Array
    """Vertices as stored, (V, 3)."""
    faces: Array
    """Triangles of these, (T, 3)."""

    def with_shape(self, corners: Array, normals: Array, vertices: Array) -> "Piece":
        """The same triangles elsewhere: corners (T, 3, 3), normals (T, 3, 3), vertices (V, 3)."""
        return replace(self, corners=corners, normals=normals, vertices=vertices)

    def reversed(self) -> "Piece":
        """The same triangles with their corners in the other order."""
        turned = {name: getattr(self, name)[:, ::-1] for name in ("corners", "normals", "rgb", "uv", "faces")}
        return replace(self, **turned)


def joined(pieces: Sequence[Piece], notes: tuple[str, ...] = ()) -> Surface:
    """One surface of all pieces; a note says how many triangles have no colour."""
    texture: list[Array] = []
    images: list[Array] = []
    for piece in pieces:
        texture.append(np.where(piece.texture >= 0, piece.texture + len(images), -1))
        images.extend(piece.images)
    plain = sum(len(p.corners) for p in pieces if not p.coloured)
    grey = (f"{plain} triangles have no colour and are grey.",) if plain else ()
    P, N, c, t = (np.concatenate([getattr(p, n) for p in pieces]) for n in ("corners", "normals", "rgb", "uv"))
    watertight = all(_closed(p.faces) for p in pieces)
    return Surface(P, N, c, t, np.concatenate(texture), tuple(images), watertight, (*grey, *notes))


def _closed(faces: Array) -> bool:
    """Whether each edge of triangles (T, 3) has exactly two of them."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())


def corner_normals(vertices: Array, faces: Array, given: Array | None) -> Array:
    """Normals at the corners of triangles (T, 3), (T, 3, 3): those of the vertices (V, 3), `given` or computed.

    At sharp edges, as those of a box, they are those of the triangles.
    """
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces, vertex_normals=given, process=False)
    vertex, face = mesh.vertex_normals[faces], face_normals(vertices[faces])
    sharp = np.einsum("tcj,tj->tc", vertex, face) < SHARP
    out: Array = np.where(sharp[..., None], face[:, None, :], vertex)
    return out


def face_normals(corners: Array) -> Array:
    """Unit normals (T, 3) of triangles (T, 3, 3), zero for those of no area."""
    a, b, c = corners.transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    out: Array = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    return out


def srgb(linear: Array) -> Array:
    """Display values of linear intensities in [0, 1], of any shape (IEC 61966-2-1)."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def linear(display: Array) -> Array:
    """Linear intensities of display values in [0, 1], of any shape (IEC 61966-2-1)."""
    return np.where(display <= 0.04045, display / 12.92, ((np.maximum(display, 0.0) + 0.055) / 1.055) ** 2.4)
