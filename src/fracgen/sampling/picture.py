"""A picture file as the network's reference: upright, on white, in the size of the run."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageChops

from fracsim.photo import cutting, reading
from fracsim.records import Array
from fracsim.scene.condition import Condition

GROUND = "none"
"""The way to cut out that keeps the ground."""


class Picture(NamedTuple):
    """The pixels, and where the file's picture lies in them."""

    pixels: Array
    """Colour, (height, width, 3) uint8."""
    corner: tuple[float, float]
    """Upper left corner of the file's picture, in widths and heights of `pixels`; negative where it was cropped."""
    size: tuple[float, float]
    """Width and height of the file's picture in the same units."""


class Box(NamedTuple):
    """Where a picture lies on a canvas [px]; `left` and `top` are negative where it was cropped."""

    left: int
    top: int
    width: int
    height: int


def load(path: Path | str, width: int, height: int, fit: str = "fit", shown: Array | None = None) -> Picture:
    """The picture in a file, turned as its EXIF orientation says, transparent parts white, [height, width, 3].

    A picture of another shape is fitted on a white canvas (fit="fit"), or its middle is cut out ("crop"). Of `shown`,
    (H, W) bool of any size, only the true part is shown. Raises ValueError naming a file that is no picture, or is too
    large or too small.
    """
    image = reading.upright(path, "image")
    if shown is not None:
        mask = Image.fromarray(shown).convert("L").resize(image.size, Image.Resampling.BILINEAR)
        image.putalpha(ImageChops.multiply(image.getchannel("A"), mask))
    image = reading.on_white(image)
    box = place(image.size, width, height, fit)
    canvas = Image.new("RGB", (width, height), "white")
    canvas.paste(image.resize((box.width, box.height), Image.Resampling.LANCZOS), (box.left, box.top))
    corner, size = (box.left / width, box.top / height), (box.width / width, box.height / height)
    return Picture(np.asarray(canvas), corner, size)


def cutout(path: Path | str, method: str, mask: str) -> Array | None:
    """The object in a picture, (H, W) bool, from the file `mask` or by `method`; None for "none", with its ground.

    Raises ValueError naming `image`, `cutout` or `mask`.
    """
    if not mask and method == GROUND:
        return None
    photo = reading.load(path, "image")
    return cutting.of_file(mask, photo, prefix="") if mask else cutting.cut(photo, method, prefix="")


def place(size: tuple[int, int], width: int, height: int, fit: str = "fit") -> Box:
    """Where a picture of `size`, width and height, lies on a canvas: fitted into it, or so that it covers it."""
    across, down = width / size[0], height / size[1]
    factor = min(across, down) if fit == "fit" else max(across, down)
    w, h = max(1, round(size[0] * factor)), max(1, round(size[1] * factor))
    return Box((width - w) // 2, (height - h) // 2, w, h)


def moved(condition: Condition, corner: Sequence[float], size: Sequence[float]) -> Condition:
    """A condition whose positions belong to the file's picture, for the canvas on which it lies at `corner`."""
    grips = (np.tile(corner, 2) + np.tile(size, 2) * condition.grips).tolist()
    return replace(condition, grips=grips, velocity=(np.tile(size, 2) * condition.velocity).tolist())
