"""Contact sheets: true clips above generated ones, colour and damage, some frames from left to right."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from fracgen.laptop import clips
from fracgen.laptop.clips import Both
from fracsim.dataset import Clip
from fracsim.records import Array

COLUMNS = 6
"""Frames of a clip, evenly spread."""
MARGIN, GAP = 110, 6
"""Width of the labels, and of the gaps between colour and damage and between clips [px]."""
MOST = 8
"""Clips of a sheet."""
COLOURS = 128
"""Colours of the file, which keep it small."""


def sheet(pairs: Sequence[Both], path: Path) -> Path:
    """Write a sheet of at most MOST pairs, evenly spread; returns its path. Raises ValueError without a pair."""
    if not pairs:
        raise ValueError(f"{path.name}: there is no generated clip to show; run the steps before.")
    chosen = [pairs[k * len(pairs) // min(MOST, len(pairs))] for k in range(min(MOST, len(pairs)))]
    bands: list[Array] = []
    for pair in chosen:
        row = pair.true.row
        title = f"{row['object']}\naxis {row['loading_axis_deg']:g} deg\ntears at {row['fracture_crit']:g}"
        bands += [labelled(strip(pair.true), f"{title}\n\ntrue"), labelled(strip(pair.made), "generated")]
        bands.append(np.full((GAP, bands[0].shape[1], 3), 255, np.uint8))
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = Image.fromarray(np.concatenate(bands[:-1]))
    picture.quantize(COLOURS).save(path, optimize=True)
    return path


def strip(clip: Clip) -> Array:
    """Frames of a clip side by side, colour then damage, (H, n W, 3) uint8; black where there is no damage."""
    colour, map_ = clips.rgb(clip), clips.damage(clip)
    frames = np.linspace(0, len(colour) - 1, COLUMNS).round().astype(int)
    grey = np.zeros_like(colour) if map_ is None else np.repeat(map_[..., None], 3, axis=-1)
    gap = np.ones((colour.shape[1], GAP, 3))
    tiles = [*colour[frames], gap, *grey[frames]]
    return np.asarray(np.rint(255 * np.clip(np.concatenate(tiles, axis=1), 0, 1)), np.uint8)


def labelled(picture: Array, text: str) -> Array:
    """A picture (H, W, 3) uint8 with a text left of it."""
    label = Image.new("RGB", (MARGIN, len(picture)), "white")
    ImageDraw.Draw(label).text((4, 4), text, fill="black")
    return np.concatenate([np.asarray(label), picture], axis=1)
