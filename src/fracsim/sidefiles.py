"""Files that a mesh file refers to: buffers and pictures of glTF, material files and textures of OBJ, textures of PLY.

Names may hold blanks, options, escapes and folders of another machine. Only text is read, never a picture.
"""

import contextlib
import json
import re
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

OPTIONS = {"-blendu": 1, "-blendv": 1, "-boost": 1, "-bm": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2,
           "-texres": 1, "-type": 1, "-o": 3, "-s": 3, "-t": 3}  # fmt: skip
"""Options of a map of OBJ and how many values follow; -o, -s and -t may have fewer."""
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")
HEADER = 1 << 16
"""Bytes among which the header of a PLY file ends."""


def named(path: Path) -> list[tuple[str, Path | None]]:
    """Names and files, in the order of the file; None for one that is missing. Empty for a file of another kind."""
    kind = path.suffix.lower()
    if kind == ".obj":
        return of_obj(path)
    if kind in (".gltf", ".glb"):
        return [(uri, _there(of_uri(path.parent, uri))) for uri in _uris(path)]
    return [(name, _there(path.parent / name)) for name in _of_ply(path)] if kind == ".ply" else []


def of_obj(path: Path) -> list[tuple[str, Path | None]]:
    """Material files of an OBJ file, each followed by its textures."""
    out: list[tuple[str, Path | None]] = []
    for name, file in libraries(path, obj_text(path)):
        out.append((name, file))
        if file is not None:
            maps = (split_map(line)[0] for line in lines(text(file), "map_kd"))
            out += [(name, found(path.parent, name)) for name in maps]
    return list(dict.fromkeys(out))


def libraries(path: Path, content: str) -> list[tuple[str, Path | None]]:
    """Names and files of the material files of an OBJ file; a name may hold blanks, and a line several names."""
    out: dict[str, Path | None] = {}
    for line in lines(content, "mtllib"):
        names = [line] if found(path.parent, line) or not line.lower().endswith(".mtl") else line.split()
        if not all(n.lower().endswith(".mtl") for n in names):
            names = [line]
        out |= {name: found(path.parent, name) for name in names}
    return list(out.items())


def split_map(rest: str) -> tuple[str, dict[str, list[float]]]:
    """What follows map_Kd: the name, which may hold blanks, and the numbers of each option before it."""
    words, options, at = rest.split(), {}, 0
    while at < len(words) - 1 and words[at].lower() in OPTIONS:
        option, at = words[at].lower(), at + 1
        values: list[float] = []
        for _ in range(OPTIONS[option]):
            if at >= len(words) - 1 or (option in ("-o", "-s", "-t") and not NUMBER.match(words[at])):
                break
            values += [float(words[at])] if NUMBER.match(words[at]) else []
            at += 1
        options[option] = values
    return (rest.split(None, at)[at] if at else rest), options


def lines(content: str, word: str) -> list[str]:
    """What follows `word` on the lines that begin with it, in any letters, and have more."""
    return [rest.strip() for rest in re.findall(rf"(?im)^[ \t]*{word}[ \t]+(\S.*)$", content)]


def found(folder: Path, name: str) -> Path | None:
    """A file by its name as written: with folders, without them, or in other letters."""
    name = name.strip().strip('"').replace("\\", "/")
    for candidate in (folder / name, folder / name.rpartition("/")[2]):
        if candidate.is_file():
            return candidate
        if candidate.parent.is_dir():
            alike = [f for f in candidate.parent.iterdir() if f.name.lower() == candidate.name.lower() and f.is_file()]
            if alike:
                return min(alike)
    return None


def text(path: Path) -> str:
    """The text of a file in UTF-8, or else in Latin 1."""
    content = path.read_bytes()
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def obj_text(path: Path) -> str:
    """The text of an OBJ file, with continued lines joined."""
    return text(path).replace("\r\n", "\n").replace("\r", "\n").replace("\\\n", " ")


def of_uri(folder: Path, uri: str) -> Path:
    """The file of an address in a glTF document."""
    return folder / unquote(uri).replace("\\", "/")


def _uris(path: Path) -> list[str]:
    """The addresses of files in a glTF document, in its order; none if it is damaged, which its reader explains."""
    with contextlib.suppress(ValueError, AttributeError, TypeError, struct.error):
        document: Any = json.loads(_json_of(path).decode("utf-8-sig"))
        items = [*document.get("buffers", ()), *document.get("images", ())]
        return list(dict.fromkeys(i["uri"] for i in items if not i.get("uri", "data:").startswith("data:")))
    return []


def _json_of(path: Path) -> bytes:
    """The JSON of a .gltf file, or of the first chunk of a .glb file, whose rest may be large."""
    with path.open("rb") as file:
        head = file.read(20)
        return file.read(struct.unpack_from("<I", head, 12)[0]) if head[:4] == b"glTF" else head + file.read()


def _of_ply(path: Path) -> list[str]:
    """The names of textures in the header of a PLY file."""
    with path.open("rb") as file:
        header = file.read(HEADER).partition(b"end_header")[0]
    return [line.decode("utf-8", "replace").strip() for line in re.findall(rb"(?m)^comment TextureFile (.*)$", header)]


def _there(path: Path) -> Path | None:
    """The path, if there is a file."""
    try:
        return path if path.is_file() else None
    except (OSError, ValueError):  # too long, or no name at all
        return None
