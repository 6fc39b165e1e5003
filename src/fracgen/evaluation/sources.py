"""Where clips lie: samples of this package, or video files of any kind."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import fracsim.dataset
from fracgen.evaluation.weights import sha256
from fracsim.dataset import folders
from fracsim.dataset.reader import TRUSTED
from fracsim.dataset.table import row_of
from fracsim.sample import schema
from fracsim.sample.folder import lacking

VIDEOS = (".mp4", ".mkv", ".webm", ".gif", ".mov", ".avi", ".m4v", ".mpg", ".mpeg", ".webp", ".apng", ".y4m")
"""Ends of the names of video files."""


@dataclass(frozen=True)
class Fault:
    """A clip, or a part of it, that cannot be scored, and why."""

    clip: str
    reason: str
    metric: str = ""
    """The metric that cannot be computed; empty = none can."""


@dataclass(frozen=True)
class Source:
    """A clip that has not been opened; it can be sent to other processes."""

    name: str
    """Id of a sample, or path of a video in its folder, without ending."""
    path: Path
    sha256: str
    """The hash of its content."""
    row: Mapping[str, Any] = field(default_factory=dict)
    """A sample's row in the table of a data set; empty for a video."""
    of: str = ""
    """The id of the simulated clip that a generated sample belongs to."""

    @property
    def is_sample(self) -> bool:
        """Whether it is a sample; else it is a video file."""
        return bool(self.row)


@dataclass(frozen=True)
class Found:
    """What a folder holds."""

    sources: list[Source]
    faults: list[Fault]


def folder(path: str, name: str, suspect: bool) -> Found:
    """The clips in a folder, which is the value of the field `name`; raises ValueError when it has none."""
    root = Path(path).expanduser()
    if not root.is_dir():
        raise ValueError(f"{name}={path} is not a folder: give a folder of samples or of videos.")
    found = _samples(root, suspect) if any(True for _ in folders.finished(root)) else _videos(root)
    if not found.sources and not found.faults:
        raise ValueError(f"{name}={path} holds neither finished samples nor videos ({', '.join(VIDEOS)}): give the "
                         "folder that they lie in.")  # fmt: skip
    return found


def single(path: Path) -> Source:
    """The clip at a path, a folder of a sample or a video file; raises ValueError when it is neither."""
    if path.is_dir():
        meta = schema.read_meta(path)
        lost = lacking(path, meta)
        if lost or not meta["complete"]:
            raise ValueError(f"{path} is not whole: {meta['reason'] if not meta['complete'] else ', '.join(lost)}")
        row = row_of(path, meta, 0)
        return Source(str(meta["id"]), path, row["sha256"], row, str(meta.get("content", {}).get("clip") or ""))
    if not path.is_file():
        raise ValueError(f"{path} is not there")
    return Source(path.stem, path, sha256(path))


def _samples(root: Path, suspect: bool) -> Found:
    """The finished samples in a folder; those that are not finished or not whole are faults."""
    try:
        clips = fracsim.dataset.open(root, suspect=True)
    except ValueError:  # none is whole
        return Found([], [Fault(name, NOT_WHOLE) for name, _ in folders.finished(root)])
    sources, faults = [], [Fault(name, "it is not finished: make it again") for name in folders.unfinished(root)]
    for clip in clips:
        if clip.row["status"] not in TRUSTED and not suspect:
            faults.append(Fault(clip.row["id"], f"it is suspect: {clip.row['reason']}; suspect=true takes it"))
            continue
        path, row = root / clip.row["path"], dict(clip.row)
        sources.append(Source(row["id"], path, row["sha256"], row, _truth(path, row)))
    there = set(clips.table["path"].to_pylist())
    faults += [Fault(name, NOT_WHOLE) for name, _ in sorted(folders.finished(root)) if name not in there]
    return Found(sources, faults)


NOT_WHOLE = "it is not whole: python -m fracsim.dataset verify says why"


def _truth(path: Path, row: Mapping[str, Any]) -> str:
    """The id of the simulated clip that a sample was generated for; "" for a simulated one."""
    if row["asset_kind"] is not None and row["producer"].startswith("fracsim "):
        return ""
    return str(schema.read_meta(path)["content"].get("clip") or "")


def _videos(root: Path) -> Found:
    """The videos below a folder, by their path without ending; several of one such path are a fault."""
    files = sorted(p for p in root.rglob("*") if p.suffix.lower() in VIDEOS and p.is_file()
                   and not any(part.startswith(".") for part in p.relative_to(root).parts))  # fmt: skip
    by_name: dict[str, list[Path]] = {}
    for file in files:
        by_name.setdefault(file.relative_to(root).with_suffix("").as_posix(), []).append(file)
    good = [Source(name, paths[0], sha256(paths[0])) for name, paths in by_name.items() if len(paths) == 1]
    bad = [Fault(name, f"several files have this name: {', '.join(p.name for p in paths)}")
           for name, paths in by_name.items() if len(paths) > 1]  # fmt: skip
    return Found(good, bad)


def described(source: Source) -> dict[str, Any]:
    """What a sample says about how it was made: producer, stage, weights; empty for a video."""
    if not source.is_sample:
        return {}
    meta = schema.read_meta(source.path)
    content, run = meta.get("content", {}), {}
    if meta["producer"] != "fracsim":
        run = dict(schema.load_document(source.path / meta["document"]).get("run") or {})
    config = run.get("config") or {}
    weight = (config.get("loss") or {}).get("lambda_const")
    told = {"producer": source.row["producer"], "stage": run.get("stage"), "streams": run.get("streams"),
            "weights": content.get("weights"), "sampler": content.get("sampler"), "name": config.get("name"),
            "train_seed": config.get("seed"), "lambda_const": weight}  # fmt: skip
    return {key: value for key, value in told.items() if value not in (None, "")}
