"""The opacity of the file if it has one, or else GrabCut."""

from fracsim.photo.cutouts import alpha, grabcut
from fracsim.photo.reading import Photo
from fracsim.records import Array

LEAST = 0.01
"""Share of the photo that is transparent where its ground was cut off; less is the soft edge of a picture."""


def cut(photo: Photo) -> Array:
    """The object, (H, W) bool; raises ImportError if it takes OpenCV, and that is not there."""
    see_through = photo.alpha is not None and float((photo.alpha < 0.5).mean()) > LEAST
    return alpha.cut(photo) if see_through else grabcut.cut(photo)
