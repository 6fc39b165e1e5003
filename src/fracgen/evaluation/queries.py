"""Where points are tracked from: a grid inside an object.

Positions are measured from the top left corner of a picture, x right and y down [px]: the centre of the first pixel is
(0.5, 0.5), as in the tracks of samples.
"""

import numpy as np
from scipy import ndimage

from fracsim.records import Array


def grid(mask: Array, stride: float, erode: float) -> Array:
    """Points of a square grid inside a mask (H, W) bool that lie at least `erode` px from its edge, (N, 2) [px].

    Neighbours are `stride` px apart. What lies beyond the picture is no part of the object.
    """
    height, width = mask.shape
    x, y = (np.arange(stride / 2, size, stride) for size in (width, height))
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    # Distances are between centres of pixels; the edge lies half a pixel nearer. The first centre is that of the frame.
    depth = ndimage.distance_transform_edt(np.pad(mask, 1)) - 0.5
    inside: Array = points[ndimage.map_coordinates(depth, points.T[::-1] + 0.5, order=1) >= erode]
    return inside
