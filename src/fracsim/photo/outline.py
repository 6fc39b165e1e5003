"""Where a photo lies in the world: upright in the plane of the object's centre, seen by a camera in front of it.

Photo coordinates are in pixels from the top left corner, x right and y down. The object's outline has its largest
extent asset.size and the centre of its bounding box at CENTRE.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import scipy  # which loads its parts where they are used
from PIL import Image

from fracsim.camera import PHOTO_DISTANCE, View
from fracsim.photo import cutting
from fracsim.photo.reading import Photo, load
from fracsim.records import Array
from fracsim.scene.vocab import CENTRE, Asset

MARGIN = 1.05
"""A frame holds at least the object's bounding box times this."""


@dataclass(frozen=True, eq=False)
class Outline:
    """A photo and the object in it."""

    photo: Photo
    mask: Array
    """Whether a pixel shows the object, (H, W) bool."""

    @property
    def box(self) -> tuple[Array, Array]:
        """Upper left and lower right corner of the object, (2,) each [px]."""
        rows, columns = np.flatnonzero(self.mask.any(axis=1)), np.flatnonzero(self.mask.any(axis=0))
        return np.array([columns[0], rows[0]], float), np.array([columns[-1], rows[-1]], float) + 1

    @property
    def centre(self) -> Array:
        """Centre of the object's bounding box, (2,) [px]."""
        lo, hi = self.box
        out: Array = (lo + hi) / 2
        return out

    @property
    def extent(self) -> float:
        """Largest extent of the object [px]."""
        lo, hi = self.box
        return float((hi - lo).max())

    def to_plane(self, at: Array) -> Array:
        """Points of the photo [px], (..., 2), as right and up from the object's centre, (..., 2), in its extents."""
        out: Array = (np.asarray(at) - self.centre) * (1, -1) / self.extent
        return out

    def to_photo(self, at: Array) -> Array:
        """Points of the photo [px], (..., 2), of points of the plane, (..., 2): the inverse of `to_plane`."""
        out: Array = np.asarray(at) * (1, -1) * self.extent + self.centre
        return out

    def colours(self, at: Array, width: float) -> Array:
        """Colours (N, 3) in [0, 1] at points right and up from the centre, (N, 2), means over `width` [extents]."""
        level = round(np.log2(max(width * self.extent, 1)))  # a pixel of this level is about as wide
        picture, factor = self._level(level)
        where = (self.to_photo(at) * factor)[:, ::-1].T - 0.5
        return np.stack(
            [scipy.ndimage.map_coordinates(picture[..., c], where, order=1, mode="nearest") for c in range(3)], axis=-1
        )

    def _level(self, level: int) -> tuple[Array, Array]:
        """The photo, 2^level times smaller, with the object's nearest colours as its ground; and the factor of both
        sides, (2,).
        """
        size = [max(1, round(n / 2**level)) for n in self._own.size]
        small = self._own.resize((size[0], size[1]), Image.Resampling.BOX)
        return np.asarray(small) / np.float32(255), np.array(size) / self._own.size

    @cached_property
    def _own(self) -> Image.Image:
        """The photo with the object's nearest colours as its ground."""
        nearest = scipy.ndimage.distance_transform_edt(~self.mask, return_distances=False, return_indices=True)
        return Image.fromarray(self.photo.rgb[tuple(nearest)])

    def frame(self, width: int, height: int) -> tuple[float, float, float, float]:
        """The part of the photo that a picture of width x height shows: left, top, width and height [px].

        It is as large as fits into the photo, and near its middle, but holds the object; where that is wider than the
        frame, it reaches out of the photo.
        """
        whole, (lo, hi) = np.array(self.photo.size, float), self.box
        size = min(whole[0], whole[1] * width / height) * np.array([1, height / width])
        size *= max(1.0, float((MARGIN * (hi - lo) / size).max()))
        corner = np.clip((whole - size) / 2, np.minimum(0, whole - size), np.maximum(0, whole - size))
        spare = (MARGIN - 1) / 2 * (hi - lo)
        corner = np.clip(corner, hi + spare - size, lo - spare)
        return (*map(float, corner), *map(float, size))  # type: ignore[return-value]

    def view(self, size: float, width: int, height: int) -> View:
        """The camera whose picture of width x height px is `frame`, for an object of largest extent `size` [m]."""
        left, top, wide, high = self.frame(width, height)
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        distance = PHOTO_DISTANCE * size
        pose[:3, 3] = -pose[:3, :3] @ (np.array(CENTRE) + (0, 0, distance))
        focal = distance * self.extent / size * width / wide
        cx, cy = (self.centre - (left, top)) * (width / wide, height / high)
        return View(pose, focal, focal, float(cx), float(cy), width, height)


def outline(asset: Asset) -> Outline:
    """The photo asset.path and the object in it, found by asset.mask or asset.cutout.

    Raises ValueError for a file that cannot be used, or a photo in which nothing is found.
    """
    stamps = tuple(_stamp(path) for path in (asset.path, asset.mask))
    return _outline(asset.path, asset.mask, asset.cutout, stamps)


def _stamp(path: str) -> tuple[int, int]:
    """What changes with a file's content; zeros if there is none."""
    try:
        found = Path(path).stat() if path else None
    except OSError:
        found = None
    return (found.st_mtime_ns, found.st_size) if found else (0, 0)


@lru_cache(maxsize=2)
def _outline(path: str, mask: str, method: str, stamps: object) -> Outline:
    photo = load(path)
    return Outline(photo, cutting.of_file(mask, photo) if mask else cutting.cut(photo, method))
