"""What a sample folder holds: names of files, meta.json, and the document that makes the sample again."""

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from fracsim.sample.identity import FRACSIM, digest
from fracsim.scene.vocab import Scene

VERSION = 3
READABLE = (1, 2, 3)
"""Versions that `read_meta` understands. Version 1 held scenes only, and not the content that names them; versions 1
and 2 had no outliers."""
META = "meta.json"
"""Everything about the sample that is not an array; `complete` is true only when all of it is there."""
SCENE = "scene.yaml"
"""The document of a simulated sample."""
RGB = "rgb.mkv"
"""uint8 colour, FFV1, lossless."""
ALPHA = "alpha.mkv"
"""Coverage in [0, 1] as code / 65535, FFV1 gray16."""
TRACKS = "tracks.npz"
"""xy [T, M, 2] float32 [px], visible [T, M] bool, particles [M] int64."""
HISTORY = "history.npz"
"""The curves of report.png, one array each."""
STRIP = "strip.mp4"
REPORT = "report.png"
JOURNAL = "frames.jsonl"
"""The ranges and outliers of each frame while a sample is written; at the end they move into meta.json."""


def map_file(name: str) -> str:
    """File of a map: FFV1 gray16 [C H, W], the C channels of a frame one above the other, codes as in `quantise`.

    Values are the quantity times its coverage (Eq. 6).
    """
    return f"maps/{name}.mkv"


def inventory(folder: Path) -> dict[str, dict[str, Any]]:
    """Size and sha256 of every file of a sample but those that describe it."""
    files = (p for p in sorted(folder.rglob("*")) if p.is_file() and p.name not in (META, JOURNAL))
    return {p.relative_to(folder).as_posix(): {"bytes": p.stat().st_size, "sha256": digest(p)} for p in files}


def save_document(document: Mapping[str, Any], path: Path) -> None:
    """Write a document as YAML."""
    OmegaConf.save(OmegaConf.create(dict(document)), path)


def load_document(path: Path) -> dict[str, Any]:
    """The document in a YAML file; raises ValueError when it cannot be read."""
    try:
        document = OmegaConf.to_container(OmegaConf.load(path))
    except (OSError, ValueError, OmegaConfBaseException) as error:
        raise ValueError(f"{path} cannot be read: {error}. Make the sample again.") from None
    assert isinstance(document, dict)
    return {str(k): v for k, v in document.items()}


def load_scene(path: Path) -> Scene:
    """The scene in a YAML file written from one; raises ValueError when it is none."""
    try:
        scene = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(Scene), OmegaConf.load(path)))
    except (OSError, OmegaConfBaseException) as error:
        raise ValueError(f"{path} is not a scene of this version of fracsim: {error}") from None
    assert isinstance(scene, Scene)
    return scene


def write_meta(folder: Path, meta: Mapping[str, Any]) -> None:
    """Write meta.json at once: a reader sees the old or the new one, never a part."""
    new = folder / f"{META}.new"
    new.write_text(_lines(plain(meta), 3) + "\n", encoding="utf-8")
    os.replace(new, folder / META)


def _lines(value: Any, depth: int) -> str:
    """JSON with a line for each entry of the outer `depth` dictionaries, so that people can read it."""
    if not isinstance(value, dict) or not value or depth == 0:
        return json.dumps(value)
    indent = "  " * (4 - depth)
    entries = (f"{indent}{json.dumps(k)}: {_lines(v, depth - 1)}" for k, v in value.items())
    return "{\n" + ",\n".join(entries) + f"\n{indent[2:]}}}"


def read_meta(folder: Path) -> dict[str, Any]:
    """meta.json of a sample with the entries of the present version; `schema` stays the version on disk.

    Raises ValueError when `folder` is no sample, or one of an unknown schema version.
    """
    if not (folder / META).is_file():
        raise ValueError(f"{folder} is not a sample: it has no {META}. Give a folder that fracsim has written.")
    try:
        meta = json.loads((folder / META).read_text(encoding="utf-8"))
        version = meta["schema"]
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"{folder} is not a sample: its {META} is damaged. Make the sample again.") from None
    if version not in READABLE:
        raise ValueError(
            f"{folder} has schema version {version}, but this fracsim reads versions {' and '.join(map(str, READABLE))}"
            ": make the sample again, or read it with the version of fracsim that its meta.json names."
        )
    assert isinstance(meta, dict)
    if version == 1:
        meta = {
            "producer": FRACSIM,
            "content": {},
            "document": SCENE,
            "alpha": bool(meta["rgb"] or meta["maps"]),
            **meta,
        }
    return {"outliers": {name: [] for name in meta["maps"]}, **meta} if version < 3 else meta


def plain(value: Any) -> Any:
    """A value as JSON can hold it: arrays as lists, records as dicts, numbers that are not finite as null."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, (str, int, type(None))) else str(value)
