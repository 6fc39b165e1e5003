"""A clip as it comes back from the VAE: what a generator that works in its latents can reach at best."""

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
import torch

from fracgen import vae
from fracgen.config.model import Vae
from fracgen.evaluation.clip import ALPHA, TRACKS, Clip
from fracgen.layout import RGB
from fracgen.vae import FrozenVae
from fracsim.records import Array

_loaded: dict[str, FrozenVae] = {}
"""The VAE of this process, by its configuration."""


def vae_of(cfg: Vae) -> FrozenVae:
    """The VAE of a configuration, loaded once; raises ValueError for weights that are missing or do not fit."""
    key = repr(asdict(cfg))
    if key not in _loaded:
        _loaded[key] = vae.load(cfg, "cuda" if torch.cuda.is_available() else "cpu")
    return _loaded[key]


def coded(clip: Clip, cfg: Vae) -> Clip:
    """A clip whose colour and maps were encoded and decoded, each by itself; it has neither coverage nor tracks."""
    loads: dict[str, Callable[[], Any]] = {
        name: partial(_stream, name, load, cfg) for name, load in clip.loads.items() if name not in (ALPHA, TRACKS)
    }
    return Clip(clip.name, clip.frames, clip.height, clip.width, clip.fps, loads, clip.scales)


def _stream(name: str, load: Callable[[], Array], cfg: Vae) -> Array:
    """A stream after the round trip: colour (F, h, w, 3) uint8, a map (F, h, w, 1 or 3) in [0, 1]."""
    before = load()
    if name == RGB:
        return np.asarray(np.rint(255 * round_trip(before / np.float32(255), cfg)), np.uint8)
    after = round_trip(before, cfg)
    return after.mean(axis=-1, keepdims=True) if before.shape[-1] == 1 else after


def round_trip(video: Array, cfg: Vae) -> Array:
    """A video (F, h, w, 1 or 3) in [0, 1], encoded and decoded, (F, h, w, 3) float32.

    Raises ValueError for another number of frames than 1 + 4 n, and for sizes that are not multiples of 16.
    """
    there = vae_of(cfg)
    frames = torch.from_numpy(np.ascontiguousarray(video, np.float32)).movedim(-1, 0).expand(3, -1, -1, -1)[None]
    return np.asarray(there.decode(there.encode(frames))[0].movedim(0, -1).cpu().numpy(), np.float32)
