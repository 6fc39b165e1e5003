"""What the file itself calls opaque, as in a PNG that was cut out by hand."""

from fracsim.photo.reading import Photo
from fracsim.records import Array


def cut(photo: Photo) -> Array:
    """Where the opacity is at least a half, (H, W) bool; raises ValueError for a photo without transparent parts."""
    if photo.alpha is None:
        raise ValueError("the file has no transparent parts")
    mask: Array = photo.alpha >= 0.5
    return mask
