"""Where the object is in a picture: from its coverage where that is known, else by its distance from the background."""

import numpy as np
from scipy import ndimage

from fracgen.evaluation.clip import ALPHA, Clip
from fracsim.records import Array

COVERED = 0.5
"""A pixel belongs to the object when more than this part of it is covered."""
DISTANCE = 20.0
"""Least distance of a colour from the background's that is foreground, of 255; codecs of video stay below it."""
TIMES = 3.0
"""What is foreground lies farther than the border's median distance this many times, as on a rough background."""
PART = 0.1
"""Pieces that are smaller than this part of the largest one are specks; the halves of a torn object are none."""
HOLE = 0.01
"""Holes that are smaller than this part of the largest piece are filled, as highlights on a white background."""


def mask(clip: Clip, frame: int) -> Array:
    """The object in a frame of a clip, (H, W) bool: by its alpha if the clip has one, else by `foreground`."""
    return np.asarray(clip.alpha[frame] > COVERED) if clip.has(ALPHA) else foreground(clip.rgb[frame])


def foreground(rgb: Array) -> Array:
    """What differs from the background in a picture (H, W, 3) uint8, as (H, W) bool; all False when nothing does.

    The background has the median colour of the picture's border. The distance of a colour is the largest of those of
    its channels. What remains is the largest piece, and others of a comparable size, without small holes.
    """
    picture = np.asarray(rgb, np.float32)
    border = np.concatenate([picture[0], picture[-1], picture[1:-1, 0], picture[1:-1, -1]])
    background = np.median(border, axis=0)
    rough = float(np.median(np.abs(border - background).max(axis=-1)))
    far = np.abs(picture - background).max(axis=-1) > max(DISTANCE, TIMES * rough)
    labels, pieces = ndimage.label(far)
    if not pieces:
        return np.asarray(far)
    areas = np.bincount(labels.ravel())[1:]
    kept = np.concatenate([[False], areas >= PART * areas.max()])[labels]
    return np.asarray(kept | _small_holes(kept, HOLE * areas.max()))


def _small_holes(kept: Array, most: float) -> Array:
    """Holes of a mask (H, W) of at most `most` pixels, (H, W) bool."""
    labels, _ = ndimage.label(ndimage.binary_fill_holes(kept) & ~kept)
    small = np.bincount(labels.ravel()) <= most
    small[0] = False
    return np.asarray(small[labels])
