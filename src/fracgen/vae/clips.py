"""The clips of a data set as a VAE sees them: colour, maps as `fracsim.codec` shows them, the loading's blobs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from fracgen import conditioning, draws
from fracgen.layout import MAPS, MULTIPLE, RGB, TIME
from fracsim import codec, dataset, maps
from fracsim.dataset import progress
from fracsim.records import Array

FORCE = "force"
"""Name of the loading's video."""
PERCENTILE = 99.5
"""Percentile of a map's magnitudes in a clip that is shown as 1, where the map has no fixed scale."""


@dataclass(frozen=True)
class Videos:
    """Videos [F, H, W, 3] uint8 of one clip by stream; F = 1 + 4 n, H and W are multiples of 16."""

    id: str
    streams: dict[str, Array]


def load(folder: str, count: int) -> list[Videos]:
    """At most `count` clips, evenly spread over the data set in `folder`; raises ValueError for fewer than 2."""
    clips = dataset.open(folder)
    if len(clips) < 2:
        raise ValueError(f"data={folder} has {len(clips)} clip(s), but training and judging need 2 or more: simulate "
                         "some, as python -m fracsim +sweep=smoke.")  # fmt: skip
    chosen = clips.take(spread(len(clips), count))
    return [_videos(clip) for clip in progress.shown(chosen, len(chosen), "read clips")]


def spread(total: int, count: int) -> list[int]:
    """Up to `count` numbers below `total`, evenly spread."""
    count = min(total, count)
    return [(2 * k + 1) * total // (2 * count) for k in range(count)]


def _videos(clip: dataset.Clip) -> Videos:
    sample = clip.sample
    frames = 1 + (sample.frames - 1) // TIME * TIME
    width, height = (size // MULTIPLE * MULTIPLE for size in sample.meta["size"])
    if not width or not height:
        raise ValueError(f"data: {sample.path} has pictures smaller than {MULTIPLE} x {MULTIPLE} px; simulate larger "
                         "ones.")  # fmt: skip
    streams = {RGB: clip.read(RGB, 0, frames)} if sample.meta["rgb"] else {}
    for name in MAPS:
        if name in sample.meta["maps"]:
            raw = clip.read(name, 0, frames)
            streams[name] = _bytes(codec.encode(raw, maps.load(name).SCALE or codec.scale(raw, PERCENTILE)))
    paths = conditioning.scene_paths(sample.scene, frames)
    streams[FORCE] = _bytes(conditioning.blobs(paths, *sample.meta["size"]))
    return Videos(str(clip.row["id"]), {name: video[:, :height, :width] for name, video in streams.items()})


def _bytes(video: Array) -> Array:
    """A video in [0, 1] of any shape as uint8."""
    return np.asarray(np.rint(255 * video), np.uint8)


def tensor(video: Array) -> Tensor:
    """A video [F, H, W, 3] uint8 as a clip [1, 3, F, H, W] float32 in [0, 1]."""
    return torch.from_numpy(video.copy()).permute(3, 0, 1, 2)[None].float() / 255


def crops(clips: Sequence[Videos], shape: tuple[int, int, int, int], *key: int | str) -> Tensor:
    """Random crops [B, 3, F, S, S] in [0, 1], drawn by `key`; `shape` is (B, F, S, S).

    Clips are equally likely, and streams. Raises ValueError for a clip that is smaller than a crop.
    """
    count, *box = shape
    return torch.cat([tensor(_crop(clips, box, *key, k)) for k in range(count)])


def _crop(clips: Sequence[Videos], box: Sequence[int], *key: int | str) -> Array:
    """One crop (F, S, S, 3)."""
    clip = clips[int(draws.uniform(*key, "clip") * len(clips))]
    names = list(clip.streams)
    video = clip.streams[names[int(draws.uniform(*key, "stream") * len(names))]]
    if any(side > whole for side, whole in zip(box, video.shape, strict=False)):
        frames, height, width = video.shape[:3]
        way_out = f"frames={min(box[0], frames)} size={min(box[1], width, height)}"
        raise ValueError(f"frames={box[0]} size={box[1]} are larger than clip {clip.id}, which has {frames} frames of "
                         f"{width} x {height} px: set {way_out}.")  # fmt: skip
    starts = [int(draws.uniform(*key, axis) * (whole - side + 1))
              for axis, side, whole in zip("tyx", box, video.shape, strict=False)]  # fmt: skip
    return video[tuple(slice(start, start + side) for start, side in zip(starts, box, strict=True))]
