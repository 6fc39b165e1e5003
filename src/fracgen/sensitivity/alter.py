"""Clips made wrong in one way; what is asked of them is altered when it is asked for.

Shapes: T frames, H rows, W columns, C channels.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy import ndimage

from fracgen.evaluation.clip import ALPHA, TRACKS, Clip
from fracgen.layout import DAMAGE, MAPS, RGB, STRAIN, STRESS
from fracsim.records import Array

SHOWN = (RGB, *MAPS)
"""Streams that people and networks see."""
EXCHANGED = (STRAIN, STRESS, DAMAGE)
"""Maps of which each shows the next one."""


def blurred(clip: Clip, sigma: float) -> Clip:
    """Colour and maps blurred by a Gaussian of standard deviation `sigma` [px]."""
    return _changed(clip, SHOWN, lambda name, video: _blur(video, sigma))


def noisy(clip: Clip, sigma: float, seed: int) -> Clip:
    """Colour and maps with normal noise of standard deviation `sigma`, a part of their range."""
    return _changed(clip, SHOWN, lambda name, video: _noise(video, sigma, seed, SHOWN.index(name)))


def frozen(clip: Clip) -> Clip:
    """All streams as in the first frame."""
    return late(clip, clip.frames)


def late(clip: Clip, frames: int) -> Clip:
    """All streams later by a number of frames: the first frame is held that long."""
    numbers = np.maximum(np.arange(clip.frames) - frames, 0)
    return _changed(clip, (*SHOWN, ALPHA), lambda name, video: video[numbers])


def exchanged(clip: Clip) -> Clip:
    """Strain shown as stress, stress as damage, damage as strain; colour and flow as they are."""
    there = [name for name in EXCHANGED if clip.has(name)]
    return _with(clip, {name: clip.loads[other] for name, other in zip(there, there[1:] + there[:1], strict=True)})


def maps_of(clip: Clip, other: Clip) -> Clip:
    """Colour as it is, maps of another clip of equal size."""
    return _with(clip, {name: other.loads[name] for name in MAPS if clip.has(name) and other.has(name)})


def _changed(clip: Clip, names: Sequence[str], change: Callable[[str, Array], Array]) -> Clip:
    """The clip whose streams `names`, (T, H, W, C) or (T, H, W) each, are changed; tracks are left out, since they
    would tell where material was."""

    def load(name: str) -> Callable[[], Any]:
        return lambda: change(name, clip.get(name))

    return _with(clip, {name: load(name) for name in names if clip.has(name)})


def _with(clip: Clip, loads: Mapping[str, Callable[[], Any]]) -> Clip:
    """The clip with other streams in place of some of its own, without tracks."""
    kept = {name: load for name, load in clip.loads.items() if name != TRACKS}
    return Clip(clip.name, clip.frames, clip.height, clip.width, clip.fps, {**kept, **loads}, clip.scales)


def _blur(video: Array, sigma: float) -> Array:
    """A video (T, H, W, C) blurred in its pictures; bytes stay bytes."""
    out = ndimage.gaussian_filter(np.asarray(video, np.float32), (0, sigma, sigma, 0), mode="nearest")
    return _like(out, video)


def _noise(video: Array, sigma: float, seed: int, stream: int) -> Array:
    """A video (T, H, W, C) with noise, cut off at its range; bytes stay bytes."""
    top = 255 if video.dtype == np.uint8 else 1
    noise = np.random.default_rng((seed, stream)).normal(0, sigma * top, video.shape)
    return _like(np.clip(video + noise, 0, top), video)


def _like(values: Array, video: Array) -> Array:
    """Values, any shape, in the type of a video."""
    return np.asarray((np.rint(values) if video.dtype == np.uint8 else values).astype(video.dtype))
