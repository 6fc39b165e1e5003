"""Copies of a data set as tar shards that `webdataset` and `datasets` read.

A clip is the files KEY.rgb.mkv, KEY.stress.mkv, ..., KEY.meta.json, KEY.document.yaml; a shard is named after its
split. The same clips give the same bytes, so that an export that was interrupted is continued.
"""

import hashlib
import io
import json
import os
import tarfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from fracsim.dataset.choice import TRACKS, Summary, chosen
from fracsim.dataset.progress import Progress, silent
from fracsim.dataset.reader import Clip, Clips
from fracsim.dataset.table import COLUMNS, FLAG, TEXT, VIDEOS
from fracsim.sample import schema
from fracsim.sample.identity import digest

INDEX = "index.json"
"""What the shards hold: name, keys, bytes and sha256 of each."""
GIGABYTE = 1_000_000_000
NONE = -1
"""A number that a clip does not have, as the break frame of one that holds: loaders take the type from a few clips."""
LOCAL = ("tracks_file", "path", "written", *(f"{name}_file_name" for name in VIDEOS))
"""Columns of the table that are about the folder of the data set, not about the clip."""


@dataclass(frozen=True)
class Member:
    """A file in a shard."""

    name: str
    sha256: str
    size: int
    path: Path | None = None
    """Where it lies; None = `content` has it."""
    content: bytes = b""

    def data(self) -> bytes:
        """Its bytes; raises ValueError when they are not those that were written."""
        data = self.content if self.path is None else self.path.read_bytes()
        if hashlib.sha256(data).hexdigest() != self.sha256:
            raise ValueError(f"{self.path} has changed since it was written: run python -m fracsim.dataset verify.")
        return data


@dataclass(frozen=True)
class Shard:
    """A tar file to write."""

    name: str
    keys: tuple[str, ...]
    members: tuple[Member, ...]

    @property
    def of(self) -> str:
        """Hash of the names and hashes of its members."""
        return hashlib.sha256("".join(f"{m.name} {m.sha256}\n" for m in self.members).encode()).hexdigest()


def export(clips: Clips, out: Path, only: Sequence[str] = (), most: int = GIGABYTE,
           progress: Progress = silent) -> Summary:  # fmt: skip
    """Write `clips` as shards of at most `most` bytes into the folder `out`; shards that are there already stay.

    Raises ValueError when a clip lacks what `only` asks for, does not fit into a shard, or is damaged.
    """
    shards = plan(clips, chosen(clips, only), most)
    out.mkdir(parents=True, exist_ok=True)
    before = {entry["name"]: entry for entry in load(out)["shards"]}
    entries: list[dict[str, Any]] = []
    made = 0
    for shard in progress(shards, len(shards), "writing shards"):
        entry = before.get(shard.name, {})
        if entry.get("of") != shard.of or not _has(out / shard.name, entry["bytes"]):
            entry = _write(shard, out)
            made += 1
        entries.append(entry)
        later = [e for name, e in before.items() if name not in {e["name"] for e in entries}]
        _save({"format": "webdataset", "only": list(only), "most": most, "shards": entries + later}, out)
    for name in before.keys() - {shard.name for shard in shards}:  # the data set had more clips
        (out / name).unlink(missing_ok=True)
    _save({"format": "webdataset", "only": list(only), "most": most, "shards": entries}, out)
    return Summary(made, len(shards) - made, sum(entry["bytes"] for entry in entries))


def verify(clips: Clips, out: Path, progress: Progress = silent) -> list[str]:
    """What is wrong with the shards of `clips` in `out`, a sentence each: all of them are hashed again."""
    index = load(out)
    entries = {entry["name"]: entry for entry in index["shards"]}
    shards = plan(clips, chosen(clips, index["only"]), index["most"]) if entries else []
    problems = [] if entries else [f"{out} has no {INDEX}: nothing was exported there"]
    for shard in progress(shards, len(shards), "hashing shards"):
        entry = entries.pop(shard.name, None)
        if entry is None or not (out / shard.name).is_file():
            problems.append(f"{shard.name} is missing")
        elif digest(out / shard.name) != entry["sha256"]:
            problems.append(f"{shard.name} has changed since it was written")
        elif entry["of"] != shard.of:
            problems.append(f"{shard.name} does not hold the clips that the data set has now")
    return problems + [f"{name} holds clips that the data set has no more" for name in entries]


def plan(clips: Clips, fields: Sequence[str], most: int) -> list[Shard]:
    """The shards of `clips`, each with the clips of one split in the order of their ids."""
    shards: list[Shard] = []
    by_split: dict[str, list[Clip]] = {}
    for clip in clips:
        by_split.setdefault(clip.row["split"], []).append(clip)
    for split, those in sorted(by_split.items()):
        for number, group in enumerate(_groups(those, fields, most)):
            keys = tuple(key for key, _ in group)
            members = tuple(member for _, members in group for member in members)
            shards.append(Shard(f"{split}-{number:06d}.tar", keys, members))
    return shards


def _groups(clips: Iterable[Clip], fields: Sequence[str], most: int) -> Iterator[list[tuple[str, list[Member]]]]:
    """Ids and members of clips, as many at a time as fit into a shard."""
    group: list[tuple[str, list[Member]]] = []
    filled = 0
    for clip in sorted(clips, key=lambda clip: str(clip.row["id"])):
        members = list(_members(clip, fields))
        size = sum(_padded(tarfile.BLOCKSIZE + m.size, tarfile.BLOCKSIZE) for m in members)
        if _whole(size) > most:
            raise ValueError(f"--shard-bytes {most} is too small for clip {clip.row['id']}, which takes {_whole(size)} "
                             "bytes: give more, or leave fields out with --only.")  # fmt: skip
        if group and _whole(filled + size) > most:
            yield group
            group, filled = [], 0
        group.append((str(clip.row["id"]), members))
        filled += size
    if group:
        yield group


def _padded(size: int, unit: int) -> int:
    return -(-size // unit) * unit


def _whole(filled: int) -> int:
    """Bytes of a tar file with so many bytes of members: two empty blocks end it."""
    return _padded(filled + 2 * tarfile.BLOCKSIZE, tarfile.RECORDSIZE)


def _members(clip: Clip, fields: Sequence[str]) -> Iterator[Member]:
    """The files of a clip in a shard."""
    meta, folder, key = clip.sample.meta, clip.sample.path, clip.row["id"]
    files = {f"{key}.{what}.mkv": VIDEOS.get(what, schema.map_file(what)) for what in fields if what != TRACKS}
    if TRACKS in fields:
        files[f"{key}.tracks.npz"] = schema.TRACKS
    files[f"{key}.document.yaml"] = meta["document"]
    for name, file in files.items():
        if file not in meta["files"]:
            raise ValueError(f"{folder} has no {file}: shards are made of videos, not of a packed copy.")
        yield Member(name, meta["files"][file]["sha256"], meta["files"][file]["bytes"], folder / file)
    content = (json.dumps(_facts(clip, fields)) + "\n").encode()
    yield Member(f"{key}.meta.json", hashlib.sha256(content).hexdigest(), len(content), None, content)


def _facts(clip: Clip, fields: Sequence[str]) -> dict[str, Any]:
    """The row of a clip, and what its maps need to be decoded: the same entries of the same types in all clips.

    `datasets` takes the types from the first clips, and fails at an entry or a type that comes later.
    """
    empty = {TEXT: "", FLAG: False}
    values = {column.name: (empty.get(column.kind, NONE) if clip.row[column.name] is None else clip.row[column.name])
              for column in COLUMNS if column.name not in LOCAL}  # fmt: skip
    meta = clip.sample.meta
    maps = [name for name in fields if name in meta["maps"]]
    return values | {"units": {name: meta["maps"][name]["unit"] for name in maps},
                     "ranges": {name: meta["ranges"][name] for name in maps},
                     "outliers": {name: meta["outliers"][name] or [[NONE] * 4 + [0.0]] for name in maps}}  # fmt: skip


class _Hashing(io.RawIOBase):
    """A file that hashes what is written to it."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self.sha256, self.size = file, hashlib.sha256(), 0

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self.sha256.update(data)
        self.size += len(data)
        return self._file.write(data)


def _write(shard: Shard, out: Path) -> dict[str, Any]:
    """Write a shard under a temporary name, rename it, and return its entry of the index."""
    partial = out / f"{shard.name}.partial"
    try:
        with partial.open("wb") as file:
            hashing = _Hashing(file)
            with tarfile.open(fileobj=hashing, mode="w|", format=tarfile.USTAR_FORMAT) as tar:
                for member in shard.members:
                    info = tarfile.TarInfo(member.name)  # its time, owner and mode are those of no machine
                    info.size = member.size
                    tar.addfile(info, io.BytesIO(member.data()))
        os.replace(partial, out / shard.name)
    finally:
        partial.unlink(missing_ok=True)
    return {"name": shard.name, "keys": list(shard.keys), "bytes": hashing.size,
            "sha256": hashing.sha256.hexdigest(), "of": shard.of}  # fmt: skip


def load(out: Path) -> dict[str, Any]:
    """The index of the shards in a folder; without shards when there is none."""
    try:
        index = json.loads((out / INDEX).read_text(encoding="utf-8"))
        if isinstance(index, dict) and index.get("format") == "webdataset":
            return index
    except (OSError, ValueError):
        pass
    return {"format": "webdataset", "only": [], "most": GIGABYTE, "shards": []}


def _save(index: dict[str, Any], out: Path) -> None:
    new = out / f"{INDEX}.new"
    new.write_text(json.dumps(index, indent=1) + "\n", encoding="utf-8")
    os.replace(new, out / INDEX)


def _has(path: Path, size: int) -> bool:
    return path.is_file() and path.stat().st_size == size
