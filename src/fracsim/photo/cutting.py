"""The object in a photo: a mask from one of `fracsim.photo.cutouts` or from a file, one part without specks."""

from pathlib import Path

import numpy as np
from PIL import Image

from fracsim import registry
from fracsim.photo.reading import Photo, upright
from fracsim.records import Array

CUTOUTS = "fracsim.photo.cutouts"
SPECK = 0.03
"""Holes smaller than this share of the object are filled."""
LEAST, MOST = 0.003, 0.97
"""Share of the photo that an object may have."""
PREFIX = "asset."
"""Before the names of the fields `cutout` and `mask` of a scene."""
WAY_OUT = (
    "give its outline by {}mask=FILE, a picture that is white on the object and black elsewhere, or a PNG with a "
    "transparent ground"
)


def cut(photo: Photo, method: str = "auto", prefix: str = PREFIX) -> Array:
    """The object, (H, W) bool: its largest part, small holes filled.

    `method` is a module of `fracsim.photo.cutouts` or a file ./CUTOUT.py; `prefix` goes before the names of fields in
    errors. Raises ValueError, with the way out, when nothing is found, or next to nothing, or all.
    """
    field = f"{prefix}cutout"
    try:
        found = registry.load(CUTOUTS, method, field).cut(photo)
    except ImportError as error:
        raise ValueError(f"{field}={method} needs {error.name}, which is not installed: pip install 'fracsim[photo]', "
                         f"set {field}=border for an object on a plain ground, or {WAY_OUT.format(prefix)}."
                         ) from None  # fmt: skip
    except (ValueError, OSError) as error:
        raise ValueError(f"{field}={method}: {photo.name} cannot be cut out ({error}): {WAY_OUT.format(prefix)}."
                         ) from None  # fmt: skip
    found = np.asarray(found)
    if found.shape != photo.rgb.shape[:2]:
        raise ValueError(f"{field}={method} gives a mask of shape {found.shape} for a photo of "
                         f"{photo.rgb.shape[:2]}: return one value for each pixel.")  # fmt: skip
    return whole(found.astype(bool), photo, f"{field}={method}", prefix)


def of_file(path: str, photo: Photo, prefix: str = PREFIX) -> Array:
    """The object as a picture file marks it, (H, W) bool: white or opaque parts, its size that of the photo's shape.

    `prefix` goes before the names of fields in errors. Raises ValueError for a file that is no picture, has another
    shape, or marks nothing or all.
    """
    field = f"{prefix}mask"
    image = upright(path, field)
    width, height = photo.size
    if abs(image.width / image.height - width / height) > 0.02 * width / height:
        raise ValueError(f"{field}={path} has {image.width} x {image.height} px, another shape than {photo.name} "
                         f"with {width} x {height}: give a mask of the same picture.")  # fmt: skip
    channel = image.getchannel("A")
    if channel.getextrema()[0] == 255:
        channel = image.convert("L")
    mask = np.asarray(channel.resize(photo.size, Image.Resampling.BILINEAR)) >= 128
    return whole(mask, photo, f"{field}={Path(path).name}", prefix)


def whole(mask: Array, photo: Photo, source: str, prefix: str = PREFIX) -> Array:
    """The largest part of `mask`, (H, W) bool, without small holes, (H, W) bool; `source` is what errors name.

    Raises ValueError for a mask of next to nothing, or of all.
    """
    from scipy.ndimage import label  # here, because every configuration looks at the names of the ways to cut out

    parts, count = label(mask)
    sizes = np.bincount(parts.ravel(), minlength=count + 1)
    sizes[0] = 0
    out = parts == sizes.argmax() if count else mask
    share = float(out.mean())
    if not LEAST <= share <= MOST:
        found = "no object" if share < LEAST else "no ground beside the object"
        raise ValueError(f"{source} finds {found} in {photo.name}, {share:.1%} of its pixels: "
                         f"{WAY_OUT.format(prefix)}.")  # fmt: skip
    holes, count = label(~out)
    sizes = np.bincount(holes.ravel(), minlength=count + 1)
    tiny = sizes < SPECK * out.sum()
    tiny[0] = False
    filled: Array = out | tiny[holes]
    return filled
