"""The columns of metadata.parquet, and the row of a sample."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from fracsim.dataset.captions import caption
from fracsim.sample import schema
from fracsim.sample.health import health
from fracsim.sample.identity import FRACSIM, field_of, pinned_defaults
from fracsim.scene.classes import NONE, TRAINING_FRAMES, class_of, split_of
from fracsim.scene.knob import describe
from fracsim.scene.vocab import Scene

Row = dict[str, Any]
SECTIONS = ("material", "fracture", "loading")
"""Sections of a scene whose fields are columns."""
VIDEOS = {"rgb": schema.RGB, "alpha": schema.ALPHA,
          **{name: schema.map_file(name) for name in ("flow", "strain", "stress", "damage")}}  # fmt: skip
"""What a clip may hold as a video, and its file in the folder of the sample."""
TEXT, NUMBER, WHOLE, FLAG = pa.string(), pa.float64(), pa.int64(), pa.bool_()


@dataclass(frozen=True)
class Column:
    """A column of the table."""

    name: str
    kind: pa.DataType
    about: str
    """What it holds, for people."""
    unit: str = ""


def column_of(field: str) -> str:
    """The column of a field of a scene, as material_E of material.E."""
    return field.replace(".", "_")


def _kind(default: Any) -> pa.DataType:
    """The type of a column from the default of its field."""
    if isinstance(default, list):
        return pa.list_(NUMBER)
    kinds = ((bool, FLAG), (int, WHOLE), (float, NUMBER), (str, TEXT))  # a bool is an int, so it comes first
    return next(kind for type_, kind in kinds if isinstance(default, type_))


FIELDS = {name: (_kind(default), knob.doc, knob.unit) for name, default, knob in describe(Scene)
          if name.partition(".")[0] in SECTIONS}  # fmt: skip
"""Fields of a scene that are columns: type, meaning, unit."""
PINNED = pinned_defaults(Scene)
"""What a field has that the content of a sample leaves out."""
COLUMNS = (
    Column("id", TEXT, "hash of the scene, and name of its sample"),
    Column("object", TEXT, "name of the built-in object, or of the file of a mesh or splats"),
    Column("asset_kind", TEXT, "builtin, mesh, ply or image; null = made by another producer than fracsim"),
    Column("class", TEXT, "low_stretch, high_stretch or none"),
    Column("split", TEXT, "train, test or none: a split has objects of its own"),
    *(Column(f"{name}_file_name", TEXT, f"video of {name}; null = not recorded") for name in VIDEOS),
    Column("tracks_file", TEXT, "image positions of surface particles; null = not recorded"),
    Column("caption", TEXT, "what happens, in words, made from this row"),
    *(Column(column_of(name), *entry) for name, entry in FIELDS.items()),
    Column("seed", WHOLE, "seed of the positions of particles"),
    Column("break_frame", WHOLE, "first frame in which the object has parted; null = it holds"),
    Column("torn_frame", WHOLE, "first frame in which the grid, not the damage, has parted it; null = none"),
    Column("breaks_in_training", FLAG, f"whether break_frame is below {TRAINING_FRAMES}"),
    Column("status", TEXT, "complete (it breaks, the numbers are sound), never breaks, or suspect"),
    Column("reason", TEXT, "why it is suspect"),
    Column("frames", WHOLE, "number of frames"),
    Column("fps", NUMBER, "frames a second of simulated time", "1/s"),
    Column("width", WHOLE, "picture width", "px"),
    Column("height", WHOLE, "picture height", "px"),
    Column("particles", WHOLE, "particles of the object"),
    Column("substeps", WHOLE, "substeps of the simulation"),
    Column("seconds", NUMBER, "wall-clock time of making it", "s"),
    Column("bytes", WHOLE, "size of all files but meta.json", "B"),
    Column("sha256", TEXT, "sha256 over the sorted names and hashes of its files"),
    Column("path", TEXT, "folder of the sample in the folder of the data set"),
    Column("producer", TEXT, "program that made it, and its version"),
    Column("written", WHOLE, "when meta.json was written, after 1 January 1970", "ns"),
)  # fmt: skip
SCHEMA = pa.schema([(column.name, column.kind) for column in COLUMNS])


def row_of(folder: Path, meta: Mapping[str, Any], written: int) -> Row:
    """The row of a complete sample in `folder` with these entries of meta.json, last changed at `written` [ns].

    Raises ValueError, KeyError or TypeError when meta.json does not hold what it must.
    """
    values, report = _values(folder, meta), meta["report"]
    name = _object(folder, meta, values)
    status, reason = health(report) if meta["producer"] == FRACSIM else ("complete", "")
    broken = report.get("break_frame")
    row: Row = {column.name: None for column in COLUMNS}
    row |= {column_of(field): _typed(values[field], kind) for field, (kind, _, _) in FIELDS.items()}
    row |= {f"{what}_file_name": _file(folder, meta, file) for what, file in VIDEOS.items()}
    row |= {fact: report.get(fact) for fact in ("break_frame", "torn_frame", "particles", "substeps")}
    row |= {
        "id": meta["id"],
        "object": name,
        "asset_kind": values["asset.kind"],
        "class": _class(name, str(values["material.law"])),
        "split": split_of(name),
        "tracks_file": _file(folder, meta, schema.TRACKS),
        "seed": _typed(values["seed"], WHOLE),
        "breaks_in_training": broken is not None and broken < TRAINING_FRAMES,
        "status": status,
        "reason": reason,
        "frames": meta["frames"],
        "fps": float(meta["fps"]),
        "width": meta["size"][0],
        "height": meta["size"][1],
        "seconds": float(sum(meta["seconds"].values())),
        "bytes": sum(entry["bytes"] for entry in meta["files"].values()),
        "sha256": fingerprint(meta["files"]),
        "path": folder.name,
        "producer": f"{meta['producer']} {meta['provenance'].get(meta['producer'], '')}".strip(),
        "written": written,
    }
    return row | {"caption": caption(row)}


def _class(name: str, law: str) -> str:
    """The class of an object, or of its law if the object has none."""
    own = class_of(name)
    return class_of(law) if own == NONE else own


def fingerprint(files: Mapping[str, Mapping[str, Any]]) -> str:
    """sha256 over the sorted names and hashes of files."""
    lines = "".join(f"{name} {files[name]['sha256']}\n" for name in sorted(files))
    return hashlib.sha256(lines.encode()).hexdigest()


def _values(folder: Path, meta: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a simulated scene; those of another producer are None, unless it gave them as content."""
    if meta["producer"] != FRACSIM:
        return {name: meta["content"].get(name) for name in PINNED}
    if meta["schema"] == 1:  # has no content
        scene = schema.load_scene(folder / schema.SCENE)
        return {name: field_of(scene, name) for name in PINNED}
    return {**PINNED, **meta["content"]}


def _object(folder: Path, meta: Mapping[str, Any], values: Mapping[str, Any]) -> str:
    """The name of the object; the content of a sample knows a file by its hash only, so that the scene is asked."""
    if values["asset.kind"] not in ("builtin", None):
        return Path(schema.load_document(folder / meta["document"])["asset"]["path"]).stem
    return str(values["asset.name"] or "object")


def _file(folder: Path, meta: Mapping[str, Any], file: str) -> str | None:
    """A file of the sample relative to the folder of the data set, or None when there is none."""
    return f"{folder.name}/{file}" if file in meta["files"] else None


def _typed(value: Any, kind: pa.DataType) -> Any:
    """A value of the content, where all numbers are floats, in the type of its column."""
    return int(value) if value is not None and kind == WHOLE else value
