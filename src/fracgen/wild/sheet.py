"""The contact sheet: photo, frames of both clips, and the maps of one frame."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageOps

from fracgen.sampling import picture
from fracsim.records import Array
from fracsim.sample import Sample
from fracsim.sample.picture import frames
from fracsim.sample.strip import GAP, top

CELL = 160
"""Width and height of a picture [px]."""
TIMES = (0.0, 0.15, 0.3, 0.6)
"""Frames that are shown in colour, in lengths of the clip; the maps are those of the last but one."""
LABEL = 16


class Row(NamedTuple):
    """What there is of one photo."""

    photo: Path
    simulated: Sample | None
    generated: Sample | None


def sheet(rows: Sequence[Row], path: Path) -> Path:
    """Write the sheet of some photos, a row for each clip; returns its path."""
    bands = [band for row in rows for band in _bands(row)]
    width = max(band.shape[1] for band in bands)
    even = [np.pad(b, ((0, 0), (0, width - b.shape[1]), (0, 0)), constant_values=255) for b in bands]
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(even)).save(path, optimize=True)
    return path


def _bands(row: Row) -> list[Array]:
    """The bands of a photo: one a clip, the photo in the first."""
    given = _titled(picture.load(row.photo, CELL, CELL).pixels, row.photo.stem)
    clips = [("simulated", row.simulated), ("generated", row.generated)]
    made = [_clip(sample, name) for name, sample in clips if sample is not None]
    blank = np.full_like(given, 255)
    return [np.concatenate([blank if k else given, *clip], axis=1) for k, clip in enumerate(made or [[]])]


def _clip(sample: Sample, name: str) -> list[Array]:
    """Frames in colour, then the maps of one of them as strip.mp4 shows them."""
    count, size = sample.meta["frames"], sample.meta["size"]
    times = [round(t * (count - 1)) for t in TIMES]
    colour = [_titled(_square(sample.read("rgb", k, k + 1)[0]), f"{name}, t = {k / sample.meta['fps']:.2f} s")
              for k in times]  # fmt: skip
    strip = frames(sample)[times[-2]]
    tiles = 1 + len(sample.meta["maps"])
    wide = (strip.shape[1] - GAP) // tiles
    high = (wide - GAP) * size[1] // size[0]
    first = top(strip.shape[0], high)
    panels = [strip[first : first + high, k * wide + GAP : (k + 1) * wide] for k in range(1, tiles)]
    return [*colour, *(_titled(_square(p), n) for p, n in zip(panels, sample.meta["maps"], strict=True))]


def _square(pixels: Array) -> Array:
    """A picture (H, W, 3) uint8 fitted into a cell on white."""
    image = ImageOps.contain(Image.fromarray(np.ascontiguousarray(pixels)), (CELL, CELL), Image.Resampling.LANCZOS)
    cell = Image.new("RGB", (CELL, CELL), "white")
    cell.paste(image, ((CELL - image.width) // 2, (CELL - image.height) // 2))
    return np.asarray(cell)


def _titled(pixels: Array, text: str) -> Array:
    """A cell (CELL, CELL, 3) uint8 below a line of text, with a gap to the right."""
    out = Image.new("RGB", (CELL + GAP, CELL + LABEL + GAP), "white")
    ImageDraw.Draw(out).text((2, 2), text[: CELL // 6], fill="black")
    out.paste(Image.fromarray(pixels), (0, LABEL))
    return np.asarray(out)
