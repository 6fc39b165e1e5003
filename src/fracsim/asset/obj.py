"""OBJ files as their writers meant them: materials and textures are found, indices from the end are counted.

`fracsim.sidefiles` finds the material and texture files by their names.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fracsim import sidefiles
from fracsim.records import Array

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
    lines = sidefiles.obj_text(path)
    return _counted(lines) if FROM_END.search(lines) else lines


def materials(path: Path, content: str) -> tuple[dict[str, Material], list[str]]:
    """The materials by name of an OBJ file with its text, and a note for each file that is missing."""
    out: dict[str, Material] = {}
    notes = []
    for name, file in sidefiles.libraries(path, content):
        if file is None:
            notes.append(f"The material file {name} is missing: what it colours is grey. Put it beside {path.name}.")
        else:
            out |= _parsed(sidefiles.text(file))
    if not notes:
        used = dict.fromkeys(sidefiles.lines(content, "usemtl"))
        if lost := [name for name in used if name not in out]:
            notes.append(f"No material file defines {', '.join(lost[:5])}: what has this material is grey.")
    return out, notes


def texture(path: Path, name: str) -> Path | None:
    """The file of a texture that a material of the OBJ file `path` names; None if it is missing."""
    return sidefiles.found(path.parent, name)


def _parsed(content: str) -> dict[str, Material]:
    """The materials of a material file by name."""
    out: dict[str, Material] = {}
    current = Material()
    for line in content.splitlines():
        word, _, rest = line.strip().partition(" ") if "\t" not in line.strip() else line.strip().partition("\t")
        word, rest = word.lower(), rest.strip()
        if word == "newmtl":
            out[rest] = current = Material()
        elif word == "kd" and all(sidefiles.NUMBER.match(v) for v in rest.split()[:3]) and rest:
            values = [float(v) for v in rest.split()[:3]]
            current.kd = np.clip(np.array(values if len(values) == 3 else values[:1] * 3), 0.0, 1.0)
        elif word == "map_kd" and rest:
            _map(current, rest)
    return out


def _map(material: Material, rest: str) -> None:
    """Sets the texture of a material from what follows map_Kd: options, then a name."""
    material.map, options = sidefiles.split_map(rest)
    for option, target in (("-o", material.offset), ("-s", material.scale)):
        values = options.get(option, [])[:2]
        target[: len(values)] = values


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
