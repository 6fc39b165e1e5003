"""Folders of samples: written under a temporary name, put in place by renaming."""

import os
import re
import shutil
import socket
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from fracsim.sample import schema
from fracsim.scene.vocab import Output

LEFTOVER = re.compile(r"(\w+)\.(partial|replaced)-(\d+)(?:\.\d+)?(?:@(.+))?")
"""Id, kind, process and host of a folder under a temporary name."""
STALE = 24 * 3600.0
"""Age [s] from which a temporary folder of another host is a leftover; a frame takes seconds."""
_OURS: set[str] = set()
"""Names of the temporary folders that this process has made."""


def find(output: Output, identity: str) -> Path | None:
    """The complete sample of this id in output.folder, or None; looks at names and sizes, not at contents."""
    path = root(output) / identity
    return path if is_whole(path) else None


def root(output: Output) -> Path:
    """The folder in which samples are made."""
    return Path(output.folder).expanduser().absolute()


def is_whole(folder: Path) -> bool:
    """Whether `folder` is marked complete and has all its files, in their full size."""
    try:
        meta = schema.read_meta(folder)
        return bool(meta["complete"]) and not lacking(folder, meta)
    except (ValueError, KeyError, TypeError):
        return False


def lacking(folder: Path, meta: dict[str, Any]) -> list[str]:
    """Files of a sample that are missing or not of the size they had."""
    sizes = {name: entry["bytes"] for name, entry in meta["files"].items()}
    return [name for name, size in sizes.items() if not _has(folder / name, size)]


def _has(path: Path, size: int) -> bool:
    return path.is_file() and path.stat().st_size == size


def claim(output: Output, identity: str, needed: int) -> Path:
    """A new folder `<id>.partial-<pid>@<host>` in output.folder.

    Raises ValueError naming output.folder when it cannot be written to, has not `needed` bytes free, or already holds
    the complete sample and output.overwrite is off.
    """
    parent, given = root(output), f"output.folder={output.folder}"
    if find(output, identity) and not output.overwrite:
        raise ValueError(f"{given} already holds {identity}, the sample of this scene: read that one, "
                         "or set output.overwrite=true to make it again.")  # fmt: skip
    try:
        parent.mkdir(parents=True, exist_ok=True)
        partial = _new_folder(parent, f"{identity}.partial-{os.getpid()}")
        free = shutil.disk_usage(parent).free
    except OSError as error:
        raise ValueError(f"{given} cannot be written to ({error.strerror}): "
                         "set output.folder to a folder you may write to.") from None  # fmt: skip
    if free < needed:
        partial.rmdir()
        raise ValueError(f"{given} has {free / 1e6:.0f} MB free, but this sample may need {needed / 1e6:.0f} MB: free "
                         "some space, set output.folder to a larger disk, or lower capture.frames.")  # fmt: skip
    return partial


def _new_folder(parent: Path, name: str) -> Path:
    """Make the folder `<name>@<host>`, or with a number before the host: a killed process may have left that name."""
    number = 0
    while True:
        path = parent / f"{name}{f'.{number}' if number else ''}@{socket.gethostname()}"
        try:
            path.mkdir()
            _OURS.add(path.name)
            return path
        except FileExistsError:
            number += 1


def clear(parent: Path) -> list[str]:
    """Remove what killed processes have left in a folder of samples, and return the names.

    Temporary folders of processes that run are kept, and those of other hosts that changed within STALE seconds. A
    sample whose replacement was interrupted gets its name back.
    """
    removed = []
    for path in sorted(parent.glob("*.*-*")):
        match = LEFTOVER.fullmatch(path.name)
        if match and path.is_dir() and _is_left(path, int(match[3]), match[4]):
            target = parent / match[1]
            with suppress(OSError):
                if match[2] == "replaced" and not target.exists():
                    path.rename(target)
                else:
                    shutil.rmtree(path)
                removed.append(path.name)
    return removed


def _is_left(path: Path, pid: int, host: str | None) -> bool:
    """Whether the process that made a temporary folder is gone."""
    if host != socket.gethostname():
        return _age(path) > STALE
    if pid == os.getpid():  # processes in containers often have the same number
        return path.name not in _OURS
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except PermissionError:
        pass
    return _age(path) > STALE  # the number may belong to another process by now


def _age(path: Path) -> float:
    """Time since the last change of a folder or of a file directly in it [s]; 0 when it is gone."""
    try:
        return time.time() - max(p.stat().st_mtime for p in (path, *path.iterdir()))
    except OSError:
        return 0.0


def publish(partial: Path, identity: str, overwrite: bool) -> Path:
    """Give a complete sample its name, and return where it is.

    A complete sample that another process has put there in the meantime stays, unless `overwrite` is on.
    """
    target = partial.with_name(identity)
    for last in (False, False, True):
        try:
            if not target.exists():
                partial.rename(target)
            elif is_whole(target) and not overwrite:  # another process was faster
                shutil.rmtree(partial)
            else:
                _swap(partial, target)
            break
        except OSError:  # another process has put a sample there since: look again
            if last:
                raise
    shutil.rmtree(partial.with_name(f"{identity}.incomplete"), ignore_errors=True)  # an earlier attempt
    return target


def _swap(partial: Path, target: Path) -> None:
    """Put `partial` in the place of `target`."""
    old = target.with_name(f"{target.name}.replaced-{os.getpid()}@{socket.gethostname()}")
    target.rename(old)
    try:
        partial.rename(target)
    except OSError:
        old.rename(target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def keep_incomplete(partial: Path, identity: str) -> Path:
    """Name an unfinished sample `<id>.incomplete`, in the place of an older one, and return where it is."""
    target = partial.with_name(f"{identity}.incomplete")
    with suppress(OSError):  # it stays readable under its temporary name
        shutil.rmtree(target, ignore_errors=True)
        return partial.rename(target)
    return partial
