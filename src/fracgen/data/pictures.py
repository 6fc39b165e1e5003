"""From a clip on disk to videos in [0, 1] and the numbers that a cache keeps beside them.

Shapes: F frames, h rows and w columns of the cache's pictures.
"""

import hashlib
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from fracgen import conditioning
from fracgen.config.encode import EncodeConfig
from fracgen.layout import RGB
from fracsim import codec, maps
from fracsim.dataset import Clip
from fracsim.records import Array

NORMALISATION = 1
"""Version of the rules by which a map becomes a video; another one makes another cache."""
PART = 8
"""Frames that are coloured at once, since this takes several times their memory."""


class Video(NamedTuple):
    """A stream as the VAE sees it."""

    stream: str
    frames: Array
    """rgb [F, h, w, 3] in [0, 255], uint8 or, averaged, float32; a map [F, h, w, 1 or 3] float32 in [0, 1]."""
    scale: float | None
    """The value shown as 1, in the unit of the map; None for rgb."""

    def tensor(self) -> Tensor:
        """The frames as the VAE takes them, [1, 3, F, h, w] float32 in [0, 1]."""
        frames = torch.from_numpy(self.frames).float()
        if self.stream == RGB:
            frames = frames / 255
        return frames.permute(3, 0, 1, 2).expand(3, -1, -1, -1)[None]


def select(total: int, frames: int, how: str) -> Array:
    """Numbers of the frames that are used of a clip of `total` frames, (frames,), rising; `how` as frame_select."""
    first, last = {"head": (0, frames - 1), "tail": (total - frames, total - 1), "linspace": (0, total - 1)}[how]
    return np.round(np.linspace(first, last, frames)).astype(int)


def video(clip: Clip, stream: str, cfg: EncodeConfig) -> Video:
    """A stream of a clip: rgb as it is, a map as `fracsim.codec` shows it.

    Maps hold a quantity times its coverage (Eq. 6 of the paper), and so do their means over pixels: they are shown so,
    without division by the coverage. Raises ValueError when the clip cannot be read.
    """
    numbers = select(clip.row["frames"], cfg.frames, cfg.frame_select)
    first = int(numbers[0])
    values = shrink(clip.read(stream, first, int(numbers[-1]) + 1)[numbers - first], clip.row["width"] // cfg.width)
    if stream == RGB:
        return Video(stream, values, None)
    fixed = maps.load(stream).SCALE
    scale = codec.scale(values, cfg.percentile) if fixed is None else float(fixed)
    return Video(stream, shown(values, scale), scale)


def shown(values: Array, scale: float) -> Array:
    """A map [F, h, w, C] as `codec.encode` shows it: one of its three equal channels for a scalar, else all three.

    Shape [F, h, w, 1 or 3]. Zero is black, so that of vectors only the foreground is coloured, which is slow.
    """
    parts = np.array_split(values, -(-len(values) // PART))
    if values.shape[-1] == 1:
        return np.concatenate([codec.encode(part, scale)[..., :1] for part in parts])
    out = np.zeros((*values.shape[:-1], 3), np.float32)
    for part, there in zip(np.array_split(out, len(parts)), parts, strict=True):
        object_ = there.any(axis=-1)
        part[object_] = codec.encode(there[object_], scale)
    return out


def shrink(frames: Array, factor: int) -> Array:
    """Pictures [F, h f, w f, C] averaged over squares of f pixels, [F, h, w, C] float32; as they are for f = 1."""
    if factor == 1:
        return frames
    f, rows, columns, channels = frames.shape
    squares = frames.reshape(f, rows // factor, factor, columns // factor, factor, channels)
    return np.asarray(squares.mean(axis=(2, 4), dtype=np.float32))


def grips(clip: Clip, cfg: EncodeConfig) -> Array:
    """Positions of the two grips in the cache's pictures [px], (F, 2, 2), in the frames that are used."""
    numbers = select(clip.row["frames"], cfg.frames, cfg.frame_select)
    paths = conditioning.scene_paths(clip.sample.scene, int(numbers[-1]) + 1)[numbers]
    return np.asarray(paths * (cfg.width / clip.row["width"]))


def key(*parts: bytes) -> str:
    """A name for content: 16 hex digits of its hash."""
    return hashlib.blake2b(b"\0".join(parts), digest_size=8).hexdigest()


def grips_key(paths: Array, cfg: EncodeConfig) -> str:
    """A name for the video of blobs at `paths` [px], (F, 2, 2): equal to a millionth of a pixel, equal name."""
    rounded = np.round(paths, 6) + 0.0  # makes -0.0 0.0
    return key(rounded.tobytes(), f"{cfg.width} {cfg.height}".encode())
