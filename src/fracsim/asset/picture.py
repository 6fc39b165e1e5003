"""Pictures of textures as bytes, whatever their depth: 16-bit ones are scaled, not clipped."""

from typing import Any

import numpy as np

from fracsim.records import Array


def rgb(image: Any) -> Array:
    """Colours (H, W, 3) uint8 of a picture of Pillow."""
    return np.ascontiguousarray(np.asarray(_eight(image).convert("RGB")))


def alpha(image: Any) -> Array | None:
    """Alpha (H, W) in [0, 1] of a picture of Pillow; None if it is opaque."""
    values = np.asarray(_eight(image).convert("RGBA"))[..., 3]
    return values / 255.0 if (values < 255).any() else None


def _eight(image: Any) -> Any:
    """The picture with eight bits a channel: Pillow would clip grey levels of sixteen."""
    from PIL import Image

    if image.mode[0] not in "IF":
        return image
    values = np.asarray(image, np.float64)
    most = 1.0 if image.mode == "F" and values.max() <= 1 else 65535.0
    return Image.fromarray(np.rint(np.clip(values / most, 0, 1) * 255).astype(np.uint8))
