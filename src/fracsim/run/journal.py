"""What a sweep leaves in its folder beside the samples: a line an attempt, and a scene file a failure."""

import json
import os
import socket
from dataclasses import asdict
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from fracsim.run.attempt import Attempt

JOURNAL = "sweep.jsonl"
"""A JSON object a line, in the order in which attempts ended; all processes of a sweep write it."""
FAILURES = "failures"
"""Folder of the scenes that failed, each with the reason as a comment."""


def write(folder: Path, attempt: Attempt) -> None:
    """Append an attempt to the journal of a folder of samples; a sample that was there already is no attempt."""
    outcome = attempt.outcome
    if outcome.status == "existing":
        return
    entry = {
        "id": attempt.name,
        "status": outcome.status,
        "reason": outcome.reason,
        "seconds": {phase: round(s, 3) for phase, s in outcome.seconds.items()},
        "wall": round(attempt.wall, 3),
        "host": socket.gethostname(),
        "pid": os.getpid(),
        "at": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "overrides": list(attempt.task.overrides),
    }
    folder.mkdir(parents=True, exist_ok=True)
    # One write of one line to a file opened to append: lines of several processes do not mix.
    file = os.open(folder / JOURNAL, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
    try:
        os.write(file, (json.dumps(entry) + "\n").encode())
    finally:
        os.close(file)


def read(folder: Path) -> list[dict[str, Any]]:
    """The entries of a journal, oldest first; lines that are no JSON are left out."""
    entries = []
    path = folder / JOURNAL
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else ():
        try:
            entries.append(json.loads(line))
        except ValueError:
            continue
    return entries


def size(folder: Path) -> int:
    """Bytes in the journal."""
    path = folder / JOURNAL
    return path.stat().st_size if path.is_file() else 0


class Follower:
    """Counts the lines of a journal behind `start` [bytes], whoever writes them; reads each line once."""

    def __init__(self, folder: Path, start: int) -> None:
        self._path, self._start, self._lines = folder / JOURNAL, start, 0

    def count(self) -> int:
        """Lines so far."""
        if self._path.is_file():
            with self._path.open("rb") as file:
                file.seek(self._start)
                self._lines += file.read().count(b"\n")
                self._start = file.tell()
        return self._lines


def failure_file(folder: Path, name: str) -> Path:
    """Where the scene of a failure lies."""
    return folder / FAILURES / f"{name}.yaml"


def write_failure(folder: Path, attempt: Attempt, details: str) -> Path:
    """Write the scene of a failed attempt below its reason; `fracsim.sample.schema.load_scene` reads the file."""
    task, path = attempt.task, failure_file(folder, attempt.name)
    content = asdict(task.scene) if task.scene else dict(task.content)
    about = [attempt.outcome.reason, *details.splitlines(), f"overrides: {' '.join(task.overrides)}"]
    comment = "".join(f"# {line}".rstrip() + "\n" for text in about for line in text.splitlines())
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f".{path.name}.{os.getpid()}")
    new.write_text(comment + OmegaConf.to_yaml(OmegaConf.create(content)), encoding="utf-8")
    new.replace(path)
    return path
