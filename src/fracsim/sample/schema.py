"""What a sample folder holds, and the identity of a sample."""

import hashlib
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

from fracsim.scene.vocab import Scene

VERSION = 1
META = "meta.json"
"""Everything about the sample that is not an array; `complete` is true only when all of it is there."""
SCENE = "scene.yaml"
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
"""The ranges of each frame while a sample is written; at the end they move into meta.json."""


def map_file(name: str) -> str:
    """File of a map: FFV1 gray16 [C H, W], the C channels of a frame one above the other, codes as in `quantise`."""
    return f"maps/{name}.mkv"


def sample_id(scene: Scene, asset_sha256: str | None = None) -> str:
    """First 12 hex digits of the sha256 of the resolved scene, without `backend` and `output`.

    asset.path counts by the content of the file (`asset_sha256` if known). Raises ValueError when it cannot be read.
    """
    content = {k: v for k, v in asdict(scene).items() if k not in ("backend", "output")}
    content["asset"]["path"] = asset_digest(scene) if asset_sha256 is None else asset_sha256
    canonical = json.dumps(
        {"schema": VERSION, "scene": _numbers(content)}, sort_keys=True, separators=(",", ":"), allow_nan=False
    )
    return hashlib.sha256(canonical.encode()).hexdigest()[:12]


def _numbers(value: Any) -> Any:
    """Numbers as floats, and -0.0 as 0.0, so that speed=1 and speed=1.0 are one scene."""
    if isinstance(value, dict):
        return {k: _numbers(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_numbers(v) for v in value]
    return value if isinstance(value, (str, bool, type(None))) else float(value) + 0.0


def asset_digest(scene: Scene) -> str:
    """sha256 of the object's file, or "" for a built-in one; raises ValueError when it cannot be read."""
    if scene.asset.kind == "builtin":
        return ""
    try:
        return digest(Path(scene.asset.path).expanduser())
    except OSError as error:
        raise ValueError(
            f"asset.path={scene.asset.path} cannot be read ({error.strerror}): set asset.path to a file that can."
        ) from None


def digest(path: Path) -> str:
    """sha256 of a file, in hex."""
    sha = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            sha.update(block)
    return sha.hexdigest()


def inventory(folder: Path) -> dict[str, dict[str, Any]]:
    """Size and sha256 of every file of a sample but those that describe it."""
    files = (p for p in sorted(folder.rglob("*")) if p.is_file() and p.name not in (META, JOURNAL))
    return {p.relative_to(folder).as_posix(): {"bytes": p.stat().st_size, "sha256": digest(p)} for p in files}


def save_scene(scene: Scene, path: Path) -> None:
    """Write the resolved scene as YAML."""
    OmegaConf.save(OmegaConf.structured(scene), path)


def load_scene(path: Path) -> Scene:
    """The scene in a YAML file written by `save_scene`; raises ValueError when it is none."""
    try:
        scene = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(Scene), OmegaConf.load(path)))
    except (OSError, OmegaConfBaseException) as error:
        raise ValueError(f"{path} is not a scene of this version of fracsim: {error}") from None
    assert isinstance(scene, Scene)
    return scene


def write_meta(folder: Path, meta: dict[str, Any]) -> None:
    """Write meta.json at once: a reader sees the old or the new one, never a part."""
    fresh = folder / f"{META}.new"
    fresh.write_text(_lines(plain(meta), 3) + "\n", encoding="utf-8")
    os.replace(fresh, folder / META)


def _lines(value: Any, depth: int) -> str:
    """JSON with a line for each entry of the outer `depth` dictionaries, so that people can read it."""
    if not isinstance(value, dict) or not value or depth == 0:
        return json.dumps(value)
    indent = "  " * (4 - depth)
    entries = (f"{indent}{json.dumps(k)}: {_lines(v, depth - 1)}" for k, v in value.items())
    return "{\n" + ",\n".join(entries) + f"\n{indent[2:]}}}"


def read_meta(folder: Path) -> dict[str, Any]:
    """meta.json of a sample; raises ValueError when `folder` is no sample, or one of another schema version."""
    if not (folder / META).is_file():
        raise ValueError(f"{folder} is not a sample: it has no {META}. Give a folder that fracsim has written.")
    try:
        meta = json.loads((folder / META).read_text(encoding="utf-8"))
        version = meta["schema"]
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"{folder} is not a sample: its {META} is damaged. Make the sample again.") from None
    if version != VERSION:
        raise ValueError(
            f"{folder} has schema version {version}, but this fracsim reads version {VERSION}: "
            "make the sample again, or read it with the version of fracsim that its meta.json names."
        )
    assert isinstance(meta, dict)
    return meta


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
