"""Folders of samples: written under a temporary name, put in place by renaming."""

import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

from fracsim.sample import schema
from fracsim.scene.vocab import Output


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
    """A new folder `<id>.partial-<pid>` in output.folder.

    Raises ValueError naming output.folder when it cannot be written to, has not `needed` bytes free, or already holds
    the complete sample and output.overwrite is off.
    """
    parent, given = root(output), f"output.folder={output.folder}"
    if find(output, identity) and not output.overwrite:
        raise ValueError(f"{given} already holds {identity}, the sample of this scene: read that one, "
                         "or set output.overwrite=true to make it again.")  # fmt: skip
    try:
        parent.mkdir(parents=True, exist_ok=True)
        partial = _new_folder(parent / f"{identity}.partial-{os.getpid()}")
        free = shutil.disk_usage(parent).free
    except OSError as error:
        raise ValueError(f"{given} cannot be written to ({error.strerror}): "
                         "set output.folder to a folder you may write to.") from None  # fmt: skip
    if free < needed:
        partial.rmdir()
        raise ValueError(f"{given} has {free / 1e6:.0f} MB free, but this sample may need {needed / 1e6:.0f} MB: free "
                         "some space, set output.folder to a larger disk, or lower capture.frames.")  # fmt: skip
    return partial


def _new_folder(wanted: Path) -> Path:
    """Make the folder `wanted`, or with a number behind it: a killed process may have left one of that name."""
    path, number = wanted, 1
    while True:
        try:
            path.mkdir()
            return path
        except FileExistsError:
            path, number = wanted.with_name(f"{wanted.name}-{number}"), number + 1


def publish(partial: Path, identity: str, overwrite: bool) -> Path:
    """Give a complete sample its name, and return where it is.

    A complete sample that another process has put there in the meantime stays, unless `overwrite` is on.
    """
    target = partial.with_name(identity)
    if target.exists():
        if is_whole(target) and not overwrite:  # another process was faster
            shutil.rmtree(partial)
            return target
        _swap(partial, target)
    else:
        partial.rename(target)
    shutil.rmtree(partial.with_name(f"{identity}.incomplete"), ignore_errors=True)  # an earlier attempt
    return target


def _swap(partial: Path, target: Path) -> None:
    """Put `partial` in the place of `target`."""
    old = target.with_name(f"{target.name}.replaced-{os.getpid()}")
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
