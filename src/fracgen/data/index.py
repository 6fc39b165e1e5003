"""What a latent cache holds on disk: cache.json says how it was made, index.parquet lists its clips and its files.

cache.json is written first and never changes. The index is replaced at once, after the files that it lists, so that a
reader sees a whole cache at any time, and a process that is killed loses at most the clips of its last file.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import pyarrow as pa
import pyarrow.parquet as pq

from fracgen.layout import MAPS
from fracsim.sample.identity import digest

ABOUT, INDEX, LOCK = "cache.json", "index.parquet", ".lock"
VERSION = 1
"""Version of this layout."""
FIELDS = ("vae", "vae_dtype", "width", "height", "frames", "frame_select", "fps", "streams", "text", "text_dim",
          "image", "dtype", "normalisation")  # fmt: skip
"""Entries of cache.json beside `version`: all that latents and embeddings depend on beside the clips."""
CLIPS, FORCE, TEXT, IMAGE = "shard", "force", "text", "image"
"""Kinds of files; a file is KIND-00000.safetensors."""
REFERENCE = "reference"
_FILES_KEY = b"fracgen_files"
_WORD, _NUMBER = pa.string(), pa.float64()
SCHEMA = pa.schema([
    ("id", _WORD), ("split", _WORD), ("object", _WORD), ("class", _WORD), ("caption", _WORD),
    ("scalars", pa.list_(pa.float32())), ("scales", pa.struct([(name, _NUMBER) for name in MAPS])),
    ("E", _NUMBER), ("nu", _NUMBER), ("onset", _NUMBER), ("crit", _NUMBER), ("axis_deg", _NUMBER),
    ("sha256", _WORD), ("shard", _WORD), ("force", _WORD), ("text", _WORD), ("image", _WORD),
])  # fmt: skip
"""Columns of the index. `scales` has the value shown as 1 of each map, in its unit; `sha256` is that of the sample;
`shard` is the file with the latents, under the keys ID.STREAM and ID.reference; the last three are keys."""
Row = dict[str, Any]


@dataclass
class Index:
    """Clips and files of a cache."""

    about: dict[str, Any]
    """The entries of cache.json."""
    rows: list[Row] = field(default_factory=list)
    """One a clip, by the columns of SCHEMA; its place here is the clip's number."""
    files: dict[str, dict[str, Any]] = field(default_factory=dict)
    """`bytes`, `sha256` and `keys` of each file."""

    def where(self, kind: str) -> dict[str, str]:
        """The file of each key of the files of a kind; a later file wins."""
        mine = (name for name in sorted(self.files) if name.startswith(f"{kind}-"))
        return {key: name for name in mine for key in self.files[name]["keys"]}


def load(folder: Path) -> Index:
    """The index of a cache; raises ValueError when the folder holds none, or one of another version."""
    about = _read_about(folder)
    if about is None:
        raise ValueError(f"data.folder={folder} is no latent cache: it has no {ABOUT}. Make one by "
                         f"python -m fracgen.encode data=FOLDER output.folder={folder}.")  # fmt: skip
    if about.get("version") != VERSION or set(FIELDS) - set(about):
        raise ValueError(f"{folder / ABOUT} is of version {about.get('version')}, but this fracgen reads version "
                         f"{VERSION}: encode the data set again into another folder.")  # fmt: skip
    if not (folder / INDEX).is_file():
        return Index(about)
    try:
        table = pq.read_table(folder / INDEX)
        files = json.loads((table.schema.metadata or {})[_FILES_KEY])
    except (OSError, KeyError, ValueError) as error:
        raise ValueError(f"{folder / INDEX} cannot be read ({error}): remove it and encode again.") from None
    return Index(about, table.to_pylist(), files)


def _read_about(folder: Path) -> dict[str, Any] | None:
    """cache.json, or None when there is none; raises ValueError for a damaged one."""
    try:
        about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise ValueError(f"{folder / ABOUT} cannot be read ({error}): encode into another folder.") from None
    return about if isinstance(about, dict) else {}


def save(index: Index, folder: Path) -> None:
    """Replace the index at once."""
    table = pa.Table.from_pylist(index.rows, SCHEMA)
    with replacing(folder / INDEX) as new:
        pq.write_table(table.replace_schema_metadata({_FILES_KEY: json.dumps(index.files)}), new, compression="zstd")


def begin(folder: Path, about: Mapping[str, Any]) -> Index:
    """The index of the cache in `folder`, which is begun if there is none.

    Raises ValueError naming the first field in which the cache there differs from `about`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if _read_about(folder) is None:
        with replacing(folder / ABOUT) as new:
            new.write_text(json.dumps({"version": VERSION, **about}, indent=2) + "\n", encoding="utf-8")
    index = load(folder)
    for name in FIELDS:
        if index.about[name] != about[name]:
            raise ValueError(f"output.folder={folder} holds latents with {name}={index.about[name]}, but "
                             f"{name}={about[name]} is asked for: choose another output.folder, or set {name} as it "
                             "was.")  # fmt: skip
    return index


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name beside `path`, whose file takes the place of `path` when the block ends without an error."""
    new = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        yield new
        os.replace(new, path)
    finally:
        new.unlink(missing_ok=True)


def lock(folder: Path) -> IO[str]:
    """An open file that keeps other processes from writing; the system lets go of it when this process ends.

    Raises ValueError when another process writes to the cache.
    """
    file = (folder / LOCK).open("w")
    try:
        import fcntl  # Windows has none: there two processes are the user's to keep apart

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except ImportError:
        pass
    except OSError:
        file.close()
        raise ValueError(f"output.folder={folder} is being written by another process: wait until it has ended, or "
                         "choose another output.folder.") from None  # fmt: skip
    return file


def lacking(index: Index, folder: Path, hashes: bool = False) -> dict[str, str]:
    """What is wrong with the files of a cache by their names, by their sizes or, slowly, by their hashes."""
    found = {}
    for name, entry in index.files.items():
        path = folder / name
        if not path.is_file():
            found[name] = "is missing"
        elif path.stat().st_size != entry["bytes"]:
            found[name] = f"has {path.stat().st_size} bytes instead of {entry['bytes']}"
        elif hashes and digest(path) != entry["sha256"]:
            found[name] = "has changed: its sha256 is another one"
    return found
