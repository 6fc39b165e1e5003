"""Scalar maps as numbers again: one channel, without the floor that a video codec or a VAE leaves on the background."""

import numpy as np

from fracgen.evaluation import foreground
from fracgen.evaluation.clip import ALPHA, Clip
from fracgen.layout import RGB
from fracsim.records import Array

ENOUGH = 500_000
"""Pixels whose median is the floor of a map."""
DEADBAND = 4.0
"""Values below it are no signal [levels of 255]: a VAE does not hold black to a few levels."""


def grey(values: Array) -> Array:
    """A map as it is shown, (T, H, W, C) in [0, 1], as its mean over channels, (T, H, W) float32 in [0, 1]."""
    mean = values[..., 0] if values.shape[-1] == 1 else values.mean(axis=-1, dtype=np.float32)
    clipped: Array = np.clip(mean, 0, 1, dtype=np.float32)
    return clipped


def background(clip: Clip) -> Array:
    """Where a clip shows no object in its first picture, (H, W) bool; everywhere if it has maps only."""
    if clip.has(ALPHA) or clip.has(RGB):
        return np.asarray(~foreground.mask(clip, 0))
    return np.ones((clip.height, clip.width), bool)


def floor(values: Array, outside: Array) -> float:
    """The median of a map (T, H, W) where there is no object, `outside` (H, W) bool; 0 when there is no such place.

    Of frames that are spread over the clip, as many as have ENOUGH pixels.
    """
    if not outside.any():
        return 0.0
    count = min(len(values), max(3, ENOUGH // int(outside.sum())))
    frames = np.linspace(0, len(values) - 1, count).round().astype(int)
    return float(np.median(values[frames][:, outside]))


def deadband(values: Array, outside: Array, levels: float = DEADBAND) -> Array:
    """A map (T, H, W) less its floor on the background `outside` (H, W) bool; 0 where less than `levels` / 255 remains.

    With 0 levels the map as it is.
    """
    if not levels:
        return values
    above = values - np.float32(floor(values, outside))
    return np.asarray(np.where(above < levels / 255, np.float32(0), above))
