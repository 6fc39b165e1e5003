"""OBJ files as their writers meant them: materials and textures are found, indices from the end are counted.

The names of material and texture files may hold blanks, options and folders of another machine. `files` lists them
without reading anything but text.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fracsim.records import Array

OPTIONS = {"-blendu": 1, "-blendv": 1, "-boost": 1, "-bm": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2,
           "-texres": 1, "-type": 1, "-o": 3, "-s": 3, "-t": 3}  # fmt: skip
"""Options of a map and how many values follow; -o, -s and -t may have fewer."""
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")
FROM_END = re.compile(r"^\s*f\s.*-\d", re.MULTILINE)


@dataclass
class Material:
    """What a file says of a material."""

    kd: Array | None = None
    """Display colour, (3,)."""
    map: str = ""
    """The name of its texture, as written."""
    scale: Array = field(default_factory=lambda: np.ones(2))
    offset: Array = field(default_factory=lambda: np.zeros(2))
    """Texture coordinates are multiplied by the first, then moved by the second, (2,) each."""


def text(path: Path) -> str:
    """The text of a file, with continued lines joined and indices from the end replaced by those from the start."""
    lines = _text(path).replace("\r\n", "\n").replace("\r", "\n").replace("\\\n", " ")
    return _counted(lines) if FROM_END.search(lines) else lines


def materials(path: Path, content: str) -> tuple[dict[str, Material], list[str]]:
    """The materials by name of an OBJ file with its text, and a note for each file that is missing."""
    out: dict[str, Material] = {}
    notes = []
    for name, file in _libraries(path, content):
        if file is None:
            notes.append(f"The material file {name} is missing: what it colours is grey. Put it beside {path.name}.")
        else:
            out |= _parsed(_text(file))
    if not notes:
        used = dict.fromkeys(line.split(None, 1)[1].strip() for line in _lines(content, "usemtl"))
        if lost := [name for name in used if name not in out]:
            notes.append(f"No material file defines {', '.join(lost[:5])}: what has this material is grey.")
    return out, notes


def texture(path: Path, name: str) -> Path | None:
    """The file of a texture that a material of the OBJ file `path` names; None if it is missing."""
    return _found(path.parent, name)


def files(path: Path) -> list[Path]:
    """The existing files that an OBJ file refers to: material files and textures."""
    out = []
    for _, file in _libraries(path, _text(path)):
        if file is not None:
            maps = (m.map for m in _parsed(_text(file)).values())
            out += [file, *(found for name in maps if name and (found := _found(path.parent, name)))]
    return list(dict.fromkeys(out))


def _text(path: Path) -> str:
    """The text of a file in UTF-8, or else in Latin 1."""
    content = path.read_bytes()
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _lines(content: str, word: str) -> list[str]:
    """The lines that begin with a word and have more."""
    return re.findall(rf"^[ \t]*{word}[ \t]+\S.*$", content, re.MULTILINE)


def _libraries(path: Path, content: str) -> list[tuple[str, Path | None]]:
    """Names and files of the material files; a name may hold blanks, and a line several names."""
    out: dict[str, Path | None] = {}
    for line in _lines(content, "mtllib"):
        whole = line.split(None, 1)[1].strip()
        names = [whole] if _found(path.parent, whole) or not whole.lower().endswith(".mtl") else whole.split()
        if not all(n.lower().endswith(".mtl") for n in names):
            names = [whole]
        out |= {name: _found(path.parent, name) for name in names}
    return list(out.items())


def _found(folder: Path, name: str) -> Path | None:
    """A file by its name as written: with folders, without them, or in other letters."""
    name = name.strip().strip('"').replace("\\", "/")
    for candidate in (folder / name, folder / name.rpartition("/")[2]):
        if candidate.is_file():
            return candidate
        if candidate.parent.is_dir():
            alike = [f for f in candidate.parent.iterdir() if f.name.lower() == candidate.name.lower() and f.is_file()]
            if alike:
                return alike[0]
    return None


def _parsed(content: str) -> dict[str, Material]:
    """The materials of a material file by name."""
    out: dict[str, Material] = {}
    current = Material()
    for line in content.splitlines():
        word, _, rest = line.strip().partition(" ") if "\t" not in line.strip() else line.strip().partition("\t")
        word, rest = word.lower(), rest.strip()
        if word == "newmtl":
            out[rest] = current = Material()
        elif word == "kd" and all(NUMBER.match(v) for v in rest.split()[:3]) and rest:
            values = [float(v) for v in rest.split()[:3]]
            current.kd = np.clip(np.array(values if len(values) == 3 else values[:1] * 3), 0.0, 1.0)
        elif word == "map_kd" and rest:
            _map(current, rest)
    return out


def _map(material: Material, rest: str) -> None:
    """Sets the texture of a material from what follows map_Kd: options, then a name that may hold blanks."""
    words = rest.split()
    at = 0
    while at < len(words) - 1 and words[at].lower() in OPTIONS:
        option, at = words[at].lower(), at + 1
        values: list[float] = []
        for _ in range(OPTIONS[option]):
            if at >= len(words) - 1 or (option in ("-o", "-s", "-t") and not NUMBER.match(words[at])):
                break
            values += [float(words[at])] if NUMBER.match(words[at]) else []
            at += 1
        if option in ("-o", "-s") and values:
            target = material.offset if option == "-o" else material.scale
            target[: min(2, len(values))] = values[:2]
    material.map = rest.split(None, at)[at] if at else rest


def _counted(content: str) -> str:
    """The text with indices from the end, which count what was given so far, replaced by those from the start."""
    seen = {"v": 0, "vt": 0, "vn": 0}
    out = []
    for line in content.split("\n"):
        word = line.split(None, 1)[0] if line.strip() else ""
        if word in seen:
            seen[word] += 1
        elif word == "f" and "-" in line:
            corners = [_corner(corner, tuple(seen.values())) for corner in line.split("#")[0].split()[1:]]
            line = "f " + " ".join(corners)
        out.append(line)
    return "\n".join(out)


def _corner(corner: str, seen: tuple[int, ...]) -> str:
    """A corner v, v/vt, v//vn or v/vt/vn of a face, counted from the start."""
    parts = zip(corner.split("/"), seen, strict=False)
    return "/".join(str(n + 1 + int(p)) if p.startswith("-") else p for p, n in parts)
