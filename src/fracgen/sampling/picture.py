"""A picture file as the network's reference: upright, on white, in the size of the run."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from fracsim.photo import reading
from fracsim.records import Array


class Picture(NamedTuple):
    """The pixels, and where the file's picture lies in them."""

    pixels: Array
    """Colour, (height, width, 3) uint8."""
    corner: tuple[float, float]
    """Upper left corner of the file's picture, in widths and heights of `pixels`; negative where it was cropped."""
    size: tuple[float, float]
    """Width and height of the file's picture in the same units."""


def load(path: Path | str, width: int, height: int, fit: str = "fit") -> Picture:
    """The picture in a file, turned as its EXIF orientation says, transparent parts white, [height, width, 3].

    A picture of another shape is fitted on a white canvas (fit="fit"), or its middle is cut out ("crop"). Raises
    ValueError naming a file that is no picture, or is too large or too small.
    """
    image = reading.on_white(reading.upright(path, "image"))
    across, down = width / image.width, height / image.height
    factor = min(across, down) if fit == "fit" else max(across, down)
    w, h = max(1, round(image.width * factor)), max(1, round(image.height * factor))
    left, top = (width - w) // 2, (height - h) // 2
    canvas = Image.new("RGB", (width, height), "white")
    canvas.paste(image.resize((w, h), Image.Resampling.LANCZOS), (left, top))
    return Picture(np.asarray(canvas), (left / width, top / height), (w / width, h / height))
