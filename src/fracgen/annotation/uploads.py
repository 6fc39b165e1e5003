"""Bytes from a browser: no more than a cap, and pictures only where their header says that they are small enough."""

import io
import warnings
from threading import RLock

from PIL import Image
from starlette.requests import Request

PICTURE_BYTES = 64 * 2**20
"""Largest file of a picture."""
MASK_BYTES = 8 * 2**20
"""Largest file of a cut-out."""
JSON_BYTES = 64 * 2**10
"""Largest JSON."""
PIXELS = 64_000_000
"""Largest picture: more than cameras of phones give."""
FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "GIF", "TIFF", "MPO", "HEIF", "AVIF")
"""Formats that are read. Pillow knows more, among them some that start other programs."""
DECODING = RLock()
"""One picture is decoded and cut out at a time, so that many cannot fill the memory."""


class TooLargeError(Exception):
    """A body has more bytes than it may have."""


async def body(request: Request, most: int) -> bytes:
    """The body of a request; raises TooLargeError as soon as it has more than `most` bytes."""
    received = bytearray()
    async for chunk in request.stream():
        received += chunk
        if len(received) > most:
            raise TooLargeError(f"The file has more than {most / 2**20:g} MiB: make it smaller.")
    return bytes(received)


def check_picture(content: bytes) -> None:
    """Raise ValueError for bytes that are no picture, of another format than FORMATS, or of more than PIXELS.

    Only the header is read: nothing is decompressed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(content), formats=[f for f in FORMATS if f in _known()]) as image:
                width, height = image.size
    except Image.DecompressionBombError:
        raise ValueError(f"The picture has more than {PIXELS:,} pixels: make it smaller.") from None
    except Exception as error:  # Pillow's readers raise errors of many kinds
        raise ValueError(f"The file cannot be read as a picture ({type(error).__name__}): give a PNG, JPEG or WebP, "
                         "whole and not empty.") from None  # fmt: skip
    if width * height > PIXELS:
        raise ValueError(f"The picture has {width} x {height} pixels, more than {PIXELS:,}: make it smaller.")


def _known() -> set[str]:
    """The formats that Pillow can read here."""
    try:
        import pillow_heif

        pillow_heif.register_heif_opener()
    except ImportError:  # photos of phones are an extra
        pass
    Image.init()
    return set(Image.OPEN)
