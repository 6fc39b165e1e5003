"""Clips of given arrays, and pictures whose pixels are known."""

from typing import Any

import numpy as np

from fracgen.evaluation.clip import Clip, Pair
from fracsim.records import Array

BROWN = (150, 100, 50)


def clip(scales: dict[str, float] | None = None, fps: float = 100, **streams: Array) -> Clip:
    """A clip of the streams given, (T, H, W, C) or, of alpha, (T, H, W)."""
    frames, height, width = next(iter(streams.values())).shape[:3]
    loads: dict[str, Any] = {name: lambda video=video: video for name, video in streams.items()}
    return Clip("hand-made", frames, height, width, fps, loads, scales or {})


def pair(pred: Array, gt: Array) -> Pair:
    """A pair of colour videos (T, H, W, 3) uint8."""
    return Pair(clip(rgb=pred), clip(rgb=gt))


def grey(*levels: int, size: int = 32) -> Array:
    """Frames of one grey level each, (T, size, size, 3) uint8."""
    return np.broadcast_to(np.array(levels, np.uint8)[:, None, None, None], (len(levels), size, size, 3)).copy()


def noise(seed: int, frames: int = 3, size: int = 32) -> Array:
    """Frames of independent pixels, (T, size, size, 3) uint8."""
    return np.random.default_rng(seed).integers(0, 256, (frames, size, size, 3), np.uint8)


def boxes(*corners: tuple[int, int, int, int], size: int = 32) -> Array:
    """A mask (size, size) that is true in boxes of rows and columns (top, bottom, left, right), ends excluded."""
    out = np.zeros((size, size), bool)
    for top, bottom, left, right in corners:
        out[top:bottom, left:right] = True
    return out


def painted(mask: Array, colour: tuple[int, int, int] = BROWN, background: int = 255) -> Array:
    """A picture (..., 3) uint8 of one colour where a mask (...) holds, on a grey background."""
    return np.where(mask[..., None], np.array(colour, np.uint8), np.uint8(background))
