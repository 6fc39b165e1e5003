"""GrabCut (Rother et al. 2004) from the colours of the border; needs OpenCV."""

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from fracsim.photo.cutouts import border
from fracsim.photo.reading import Photo
from fracsim.records import Array

ROUNDS = 4
SURE = 2.5
"""Times Otsu's threshold from which on a pixel surely belongs to the object."""


def cut(photo: Photo) -> Array:
    """The object, (H, W) bool; the border is ground. Raises ImportError without OpenCV."""
    import cv2

    picture, away = border.small(photo), border.distance(photo)
    level = border.threshold(away)
    marks = np.where(away > level, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    marks[away > SURE * level] = cv2.GC_FGD
    marks[border.ring(*away.shape)] = cv2.GC_BGD
    if (marks == cv2.GC_PR_FGD).any() or (marks == cv2.GC_FGD).any():
        ground, own = np.zeros((1, 65)), np.zeros((1, 65))
        cv2.setRNGSeed(0)
        marks = np.asarray(cv2.grabCut(picture, marks, (0, 0, 0, 0), ground, own, ROUNDS, cv2.GC_INIT_WITH_MASK)[0])
    found = ((marks == cv2.GC_FGD) | (marks == cv2.GC_PR_FGD)).astype(np.float32)
    soft = Image.fromarray(gaussian_filter(found, 0.7)).resize(photo.size, Image.Resampling.BICUBIC)
    out: Array = np.asarray(soft) > 0.5
    return out
