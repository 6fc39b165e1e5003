"""What an export holds: the fields that all clips have."""

from collections.abc import Sequence
from typing import NamedTuple

from fracsim.dataset.reader import Clip, Clips

TRACKS = "tracks"


class Summary(NamedTuple):
    """What an export has done."""

    made: int
    """Files or clips that were written."""
    kept: int
    """Those that were there already."""
    bytes: int
    """Size of all of them."""


def fields(clip: Clip) -> tuple[str, ...]:
    """What a clip holds: rgb, alpha, maps by name, tracks."""
    meta = clip.sample.meta
    pictures = [name for name in ("rgb", "alpha") if meta[name]]
    return (*pictures, *meta["maps"], *([TRACKS] if "tracks.npz" in meta["files"] else []))


def chosen(clips: Clips, only: Sequence[str] = ()) -> tuple[str, ...]:
    """The fields to export: `only`, or all that any clip has; raises ValueError when a clip lacks one of them."""
    there = {clip.row["id"]: fields(clip) for clip in clips}
    if not there:
        raise ValueError(f"{clips.folder} holds no clip to export: its samples are all suspect.")
    wanted = tuple(dict.fromkeys(only)) or tuple(dict.fromkeys(name for names in there.values() for name in names))
    for identity, names in there.items():
        lost = [name for name in wanted if name not in names]
        if lost:
            common = [name for name in names if all(name in other for other in there.values())]
            raise ValueError(f"clip {identity} has no {', '.join(lost)}: all clips of an export have the same fields. "
                             f"Choose with --only from {','.join(common) or 'nothing'}, which all have.")  # fmt: skip
    return wanted
