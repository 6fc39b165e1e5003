"""What lies in the folder of a data set."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from fracsim.sample.folder import LEFTOVER
from fracsim.sample.schema import META

BESIDE = ("failures", "multirun", "strips", "sheets", "exports")
"""Folders of a data set that hold no samples."""
NAME = re.compile(r"[0-9a-f]{12}")
"""The id of a sample, which is the name of its folder."""


def temporary(name: str) -> bool:
    """Whether a folder of this name holds a sample that is being written, was not finished, or is being replaced."""
    return name.endswith(".incomplete") or LEFTOVER.fullmatch(name) is not None


def root(folder: Path | str) -> Path:
    """The folder as a path; raises ValueError when it is none."""
    path = Path(folder).expanduser()
    if not path.is_dir():
        raise ValueError(f"{folder} is not a folder: give the folder of a data set, as output.folder of its sweep.")
    return path


def finished(root: Path) -> Iterator[tuple[str, int]]:
    """Name of each folder with a meta.json that is under no temporary name, and when that was written [ns]."""
    for entry in os.scandir(root):
        if entry.name in BESIDE or entry.name.startswith(".") or temporary(entry.name):
            continue
        try:
            yield entry.name, os.stat(os.path.join(entry.path, META)).st_mtime_ns
        except OSError:  # a file, a folder of something else, or one that has just been replaced
            continue


def unfinished(root: Path) -> list[str]:
    """Names of the folders of samples that are being written, were not finished, or are being replaced."""
    return sorted(e.name for e in os.scandir(root) if temporary(e.name) and e.is_dir())


def headless(root: Path) -> list[str]:
    """Names of folders that are named like a sample but have no meta.json."""
    named = (e for e in os.scandir(root) if NAME.fullmatch(e.name) and e.is_dir())
    return sorted(e.name for e in named if not os.path.isfile(os.path.join(e.path, META)))
