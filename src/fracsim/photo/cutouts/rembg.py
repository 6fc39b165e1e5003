"""The networks of rembg (pip install rembg); weights are those that U2NET_HOME holds, or that it downloads."""

import numpy as np
from PIL import Image

from fracsim.photo.reading import Photo
from fracsim.records import Array


def cut(photo: Photo) -> Array:
    """The object, (H, W) bool. Raises ImportError without rembg, OSError without weights."""
    import rembg  # type: ignore[import-not-found]

    out: Array = np.asarray(rembg.remove(Image.fromarray(photo.rgb), only_mask=True)) >= 128
    return out
