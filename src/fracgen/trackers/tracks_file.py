"""Tracks that another program has written, as one that runs in an environment of its own: `FOLDER/CLIP.npz` a clip.

| Array | Shape | Meaning |
|---|---|---|
| `tracks` | T, M, 2 | positions of M points in all T frames, from the top left corner, x right and y down [px] |
| `visible` | T, M | whether a point is seen; without it, where its position is finite |
| `size` | 2 | width and height of the pictures that were tracked, if they were not those of the clip |

Points may lie anywhere: each query follows the nearest one that is seen in the first frame.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from fracgen.evaluation.clip import Clip, LackingError
from fracgen.evaluation.tracker import Tracker
from fracgen.trackers._nearest import follow
from fracsim.records import Array
from fracsim.scene.knob import check, knob


@dataclass(kw_only=True)
class Settings:
    """Where the files are."""

    folder: str = knob("", "folder of the files CLIP.npz")
    radius: float = knob(0.03, "a query follows the nearest point within this part of the longer side", least=0,
                         open="least")  # fmt: skip

    def __post_init__(self) -> None:
        check(self, "tracker.tracks_file")


def build(settings: Settings) -> Tracker:
    """The tracker; raises ValueError when there is no such folder."""
    if not settings.folder or not Path(settings.folder).expanduser().is_dir():
        raise ValueError(f"tracker.tracks_file.folder={settings.folder} is no folder: give the one that holds a file "
                         "CLIP.npz for each clip, with tracks (T, M, 2) and visible (T, M).")  # fmt: skip
    return TracksFile(settings)


@dataclass(frozen=True)
class TracksFile:
    """Moves each query as the nearest point of a file."""

    settings: Settings

    def __call__(self, clip: Clip, queries: Array, t0: int, t1: int) -> tuple[Array, Array]:
        """Tracks (t1 - t0 + 1, N, 2) of queries (N, 2), and what is seen; raises LackingError without a usable file."""
        xy, visible = read(Path(self.settings.folder).expanduser() / f"{clip.name}.npz", clip)
        window = slice(t0, t1 + 1)
        return follow(xy[window], visible[window], queries, self.settings.radius * max(clip.height, clip.width))

    def about(self) -> dict[str, Any]:
        """Settings."""
        return {"tracker": "tracks_file", **asdict(self.settings)}


def read(path: Path, clip: Clip) -> tuple[Array, Array]:
    """Tracks (T, M, 2) in pixels of the clip and whether they are seen (T, M); LackingError when the file is not so."""
    try:
        with np.load(path) as arrays:
            held = {name: np.asarray(arrays[name]) for name in arrays.files}
    except (OSError, EOFError, ValueError, BadZipFile) as error:
        raise LackingError(f"{clip.name} has no tracks: {path} cannot be read ({error}).") from None
    tracks = held.get("tracks", np.empty(0)).astype(np.float64)
    if tracks.ndim != 3 or len(tracks) != clip.frames or tracks.shape[2] != 2:
        raise LackingError(f"{clip.name} has no tracks: {path} must hold tracks of shape (T, M, 2) with T = "
                           f"{clip.frames}; it has {tracks.shape}.")  # fmt: skip
    visible = held.get("visible", np.isfinite(tracks).all(axis=-1)).astype(bool)
    if visible.shape != tracks.shape[:2]:
        raise LackingError(f"{clip.name} has no tracks: in {path} visible must have the shape {tracks.shape[:2]}, not "
                           f"{visible.shape}.")  # fmt: skip
    size = held.get("size", np.array([clip.width, clip.height]))
    return tracks * (np.array([clip.width, clip.height]) / size), visible
