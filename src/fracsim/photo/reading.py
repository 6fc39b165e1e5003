"""Picture files of any kind that Pillow reads: upright, in RGB, with alpha where they have it."""

import contextlib
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from PIL import Image, ImageOps

from fracsim.records import Array

LEAST = 16
"""Shortest edge of a picture that shows an object [px]."""
LONGEST = 2048
"""Longest edge of a photo that is kept [px]; a camera's are larger, and no clip shows more."""
DEEP = ("I;16", "I;16L", "I;16B", "I")
"""Modes of Pillow with 16 bits a pixel."""


@dataclass(frozen=True, eq=False)
class Photo:
    """The pixels of a photo, rows from the top."""

    rgb: Array
    """Colour, sRGB, (H, W, 3) uint8."""
    alpha: Array | None
    """Opacity in [0, 1], (H, W) float32; None for a photo without any transparent part."""
    name: str = "photo"
    """What errors call it, as asset.path=cake.jpg."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]."""
        return self.rgb.shape[1], self.rgb.shape[0]


def load(path: Path | str, field: str = "asset.path") -> Photo:
    """The photo in a file, turned as its EXIF orientation says, at most LONGEST px wide and high.

    Raises ValueError, with `field`, for a file that is no picture, or is too large or too small.
    """
    image = upright(path, field)
    if max(image.size) > LONGEST:
        image.thumbnail((LONGEST, LONGEST), Image.Resampling.LANCZOS)
    pixels = np.asarray(image)
    alpha = pixels[..., 3].astype(np.float32) / 255
    return Photo(np.ascontiguousarray(pixels[..., :3]), alpha if alpha.min() < 1 else None, f"{field}={path}")


def upright(path: Path | str | BinaryIO, field: str) -> Image.Image:
    """The picture in a file, upright, in RGBA.

    Raises ValueError, with `field`, for a file that is no picture, or is too large or too small.
    """
    with contextlib.suppress(ImportError):  # photos of phones, where that library is installed
        import pillow_heif

        pillow_heif.register_heif_opener()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path if hasattr(path, "read") else Path(path).expanduser()) as file:
                image = _rgba(ImageOps.exif_transpose(file))
    except (Image.DecompressionBombWarning, Image.DecompressionBombError):
        raise ValueError(f"{field}={path} has more than {Image.MAX_IMAGE_PIXELS} px, which is too large: make it "
                         f"smaller; {LONGEST} px along an edge are enough.") from None  # fmt: skip
    except FileNotFoundError:
        raise ValueError(f"{field}={path} is not a file, seen from {Path.cwd()}: correct the path.") from None
    except Exception as error:  # Pillow's decoders raise errors of many kinds
        heif = " (HEIC: pip install pillow-heif)" if str(path).lower().endswith((".heic", ".heif")) else ""
        raise ValueError(f"{field}={path} cannot be read as a picture ({type(error).__name__}: {error}): give a PNG, "
                         f"JPEG, WebP or another file that Pillow reads{heif}.") from None  # fmt: skip
    if min(image.size) < LEAST:
        raise ValueError(f"{field}={path} has {image.width} x {image.height} px, which is too small: give a picture of "
                         f"at least {LEAST} px along each edge.")  # fmt: skip
    return image


def on_white(image: Image.Image) -> Image.Image:
    """A picture in RGB of one in RGBA; transparent parts are white."""
    return Image.alpha_composite(Image.new("RGBA", image.size, "white"), image).convert("RGB")


def _rgba(image: Image.Image) -> Image.Image:
    """A picture of any mode in RGBA."""
    if image.mode == "F":
        raise ValueError("it has floating-point pixels of unknown range")
    if image.mode in DEEP:
        values = np.asarray(image, dtype=np.int64)
        return Image.fromarray((values // 257 if values.max() > 255 else values).astype(np.uint8)).convert("RGBA")
    return image.convert("RGBA")
