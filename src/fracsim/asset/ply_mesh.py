"""PLY meshes that trimesh reads wrongly: triangle strips, and colours as numbers from 0 to 255."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from fracsim.records import Array

HEADER = 1 << 16
"""Bytes among which a header ends."""
NUMBERS = re.compile(rb"property\s+(float|float32|float64|double)\s+(red|diffuse_red|r)\s")
RGB = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))


def is_one(path: str) -> bool:
    """Whether a PLY file is of this kind."""
    with Path(path).open("rb") as stream:
        header = stream.read(HEADER).partition(b"end_header")[0]
    return b"element tristrips" in header or bool(NUMBERS.search(header))


def read(path: str) -> Any:
    """The file as a mesh of trimesh; raises what plyfile raises."""
    import plyfile
    import trimesh

    file = plyfile.PlyData.read(path)
    elements = {e.name: e for e in file.elements}
    vertex = elements["vertex"]
    P = np.stack([np.asarray(vertex[n], np.float64) for n in "xyz"], axis=1)
    faces = [np.zeros((0, 3), int)]
    for name, triangles in (("face", _fan), ("tristrips", _strip)):
        if name in elements and elements[name].count:
            lists = next(p.name for p in elements[name].properties if hasattr(p, "len_dtype"))
            faces += [triangles(np.asarray(row, int)) for row in elements[name][lists]]
    mesh = trimesh.Trimesh(P, np.concatenate(faces), process=False)
    names = {p.name for p in vertex.properties}
    for rgb in RGB:
        if names.issuperset(rgb):
            colours = _bytes(np.stack([np.asarray(vertex[n]) for n in rgb], axis=1))
            mesh = trimesh.Trimesh(P, mesh.faces, vertex_colors=colours, process=False)
    return mesh


def _fan(row: Array) -> Array:
    """Triangles (T, 3) of a convex polygon (N,)."""
    return np.stack([np.full(max(len(row) - 2, 0), row[0]), row[1:-1], row[2:]], axis=1)


def _strip(row: Array) -> Array:
    """Triangles (T, 3) of strips (N,) that -1 separates; every second one is turned."""
    out = [np.zeros((0, 3), int)]
    for strip in np.split(row, np.flatnonzero(row < 0)):
        strip = strip[strip >= 0]
        if len(strip) > 2:
            faces = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)
            faces[1::2] = faces[1::2][:, ::-1]
            out.append(faces)
    return np.concatenate(out)


def _bytes(rgb: Array) -> Array:
    """Colours (V, 3) uint8 of integers of any width, of numbers in [0, 1], or of numbers up to 255."""
    most = np.iinfo(rgb.dtype).max if rgb.dtype.kind in "ui" and rgb.dtype.itemsize < 4 else 255.0
    if rgb.dtype.kind == "f" and rgb.max(initial=0) <= 1:
        most = 1.0
    return np.rint(np.clip(rgb / most, 0, 1) * 255).astype(np.uint8)
