"""GrabCut (Rother et al. 2004) from the colours of the border; needs OpenCV."""

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from fracsim.photo.cutouts import border
from fracsim.photo.reading import Photo
from fracsim.records import Array

ROUNDS = 4


def cut(photo: Photo) -> Array:
    """The object, (H, W) bool; what has the colours of the border at the border is ground.

    Raises ImportError without OpenCV.
    """
    import cv2

    picture, away = border.small(photo), border.distance(photo)
    other = away > border.level(away)
    marks = np.where(other, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    marks[border.ring(*away.shape) & ~other] = cv2.GC_BGD
    if other.any() and not other.all():
        ground, own = np.zeros((1, 65)), np.zeros((1, 65))
        cv2.setRNGSeed(0)
        marks = np.asarray(cv2.grabCut(picture, marks, (0, 0, 0, 0), ground, own, ROUNDS, cv2.GC_INIT_WITH_MASK)[0])
    found = (marks == cv2.GC_PR_FGD).astype(np.float32)
    soft = Image.fromarray(gaussian_filter(found, 0.7)).resize(photo.size, Image.Resampling.BICUBIC)
    out: Array = np.asarray(soft) > 0.5
    return out
