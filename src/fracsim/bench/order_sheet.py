"""Pictures of what `fracsim.bench.order` calls violated: damage in both scenes, around the frames of parting."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from fracsim.records import Array
from fracsim.run.session import Run
from fracsim.scene.vocab import Scene

GREY, RED = np.array([0.78, 0.74, 0.68]), np.array([0.75, 0.05, 0.1])
"""Colours of whole and of failed material."""
WIDTH, LINE, STEPS = 160, 22, (-3, -1, 0)
"""Width of a picture and height of a label [px]; frames around the earlier and the later parting."""


class Case(NamedTuple):
    """One scene with one pair of thresholds."""

    name: str
    scene: Scene
    frame: int
    """Frame at which it parts."""


def draw(path: Path, couples: Sequence[tuple[Case, Case]]) -> None:
    """Write a sheet: two rows a couple, the same frames in both."""
    rows = []
    for couple in couples:
        frames = sorted({case.frame + step for case in couple for step in STEPS})[-6:]
        rows += [_row(case, frames) for case in couple]
    width = max(row.shape[1] for row in rows)
    padded = [np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0)), constant_values=255) for row in rows]
    Image.fromarray(np.concatenate(padded)).save(path)


def _row(case: Case, frames: Sequence[int]) -> Array:
    """The pictures of some frames under a label, (LINE + height, width, 3) uint8."""
    run, pictures = Run(case.scene), []
    for frame in run.frames():
        if frame.index in frames:
            damage, alpha = run.render(frame, frame.d)
            picture = (1 - alpha)[..., None] + (alpha[..., None] - damage) * GREY + damage * RED
            pictures.append(_shown(picture, f"frame {frame.index}"))
        if frame.index == frames[-1]:
            break
    label = Image.new("RGB", (WIDTH * len(pictures), LINE), "white")
    text = f"{case.name}, parts in frame {case.frame}"
    ImageDraw.Draw(label).text((4, 4), text, fill="black", font=ImageFont.load_default(size=13))
    return np.concatenate([np.asarray(label), np.concatenate(pictures, axis=1)])


def _shown(picture: Array, text: str) -> Array:
    """The middle of a picture (H, W, 3) in [0, 1], small, with a text below, (height, WIDTH, 3) uint8."""
    high, wide = (n // 4 for n in picture.shape[:2])
    middle = Image.fromarray((255 * np.clip(picture, 0, 1)).astype(np.uint8)).crop((wide, high, 3 * wide, 3 * high))
    small = middle.resize((WIDTH, WIDTH * high // wide))
    ImageDraw.Draw(small).text((4, small.height - 14), text, fill="#707070", font=ImageFont.load_default(size=11))
    return np.asarray(small)
