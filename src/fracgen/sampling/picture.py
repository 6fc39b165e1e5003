"""A picture file as the network's reference: upright, on white, in the size of the run."""

import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageOps

from fracsim.records import Array

LEAST = 16
"""Shortest edge of a picture that shows an object [px]."""
DEEP = ("I;16", "I;16L", "I;16B", "I")
"""Modes of Pillow with 16 bits a pixel."""


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
    image = _read(path)
    if min(image.size) < LEAST:
        raise ValueError(f"image={path} has {image.width} x {image.height} px, which is too small: give a picture of "
                         f"at least {LEAST} px along each edge.")  # fmt: skip
    across, down = width / image.width, height / image.height
    factor = min(across, down) if fit == "fit" else max(across, down)
    w, h = max(1, round(image.width * factor)), max(1, round(image.height * factor))
    left, top = (width - w) // 2, (height - h) // 2
    canvas = Image.new("RGB", (width, height), "white")
    canvas.paste(image.resize((w, h), Image.Resampling.LANCZOS), (left, top))
    return Picture(np.asarray(canvas), (left / width, top / height), (w / width, h / height))


def _read(path: Path | str) -> Image.Image:
    """The picture in a file, upright, in RGB."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(Path(path).expanduser()) as file:
                return _opaque(ImageOps.exif_transpose(file))
    except (Image.DecompressionBombWarning, Image.DecompressionBombError):
        raise ValueError(f"image={path} has more than {Image.MAX_IMAGE_PIXELS} px, which is too large: make it "
                         "smaller; the run uses far fewer.") from None  # fmt: skip
    except Exception as error:  # Pillow's decoders raise errors of many kinds
        raise ValueError(f"image={path} cannot be read as a picture ({type(error).__name__}: {error}): give a PNG, "
                         "JPEG or another file that Pillow reads.") from None  # fmt: skip


def _opaque(image: Image.Image) -> Image.Image:
    """A picture of any mode in RGB; transparent parts are white."""
    if image.mode == "F":
        raise ValueError("it has floating-point pixels of unknown range")
    if image.mode in DEEP:
        values = np.asarray(image, dtype=np.int64)
        return Image.fromarray((values // 257 if values.max() > 255 else values).astype(np.uint8)).convert("RGB")
    if image.has_transparency_data:
        layer = image.convert("RGBA")
        return Image.alpha_composite(Image.new("RGBA", layer.size, "white"), layer).convert("RGB")
    return image.convert("RGB")
