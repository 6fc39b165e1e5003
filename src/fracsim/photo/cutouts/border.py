"""What differs in colour from the photo's border; exact for an object on a plain ground, and needs no library."""

import numpy as np
from PIL import Image
from scipy.cluster.vq import kmeans2

from fracsim.photo.reading import Photo
from fracsim.records import Array

SMALL = 384
"""Longest edge at which colours are compared [px]."""
BAND = 0.03
"""Width of the border, in longest edges."""
GROUNDS = 5
"""Colours of the ground, as of a table and a wall in light and shade."""
GREYS = 256


def cut(photo: Photo) -> Array:
    """Where the distance from the colours of the border is above Otsu's threshold, (H, W) bool."""
    away = distance(photo)
    mask = Image.fromarray((away > threshold(away)).astype(np.float32)).resize(photo.size, Image.Resampling.BILINEAR)
    out: Array = np.asarray(mask) > 0.5
    return out


def small(photo: Photo) -> Array:
    """The photo at most SMALL px wide and high, (h, w, 3) uint8."""
    image = Image.fromarray(photo.rgb)
    image.thumbnail((SMALL, SMALL), Image.Resampling.BOX)
    return np.asarray(image)


def ring(height: int, width: int) -> Array:
    """The border of a picture, (height, width) bool."""
    b = max(1, round(BAND * max(height, width)))
    out = np.ones((height, width), bool)
    out[b:-b, b:-b] = False
    return out


def distance(photo: Photo) -> Array:
    """Distance of each pixel of the small photo from the nearest colour of the border, (h, w), in standard deviations.

    Colours of the border are means of clusters; brightness counts half, since shades vary.
    """
    values = _opponent(small(photo).astype(np.float64))
    border = values[ring(*values.shape[:2])]
    means, of = kmeans2(border, min(GROUNDS, len(border)), minit="++", rng=0)
    spread = np.sqrt(np.mean((border - means[of]) ** 2)) + 2.0
    away = np.full(values.shape[:2], np.inf)
    for k in np.unique(of):
        away = np.minimum(away, np.linalg.norm(values - means[k], axis=2))
    out: Array = away / spread
    return out


def _opponent(rgb: Array) -> Array:
    """Half the brightness, red minus green, and blue minus yellow of colours (..., 3)."""
    r, g, b = np.moveaxis(rgb, -1, 0)
    return np.stack([(r + g + b) / 6, (r - g) / 1.4, (2 * b - r - g) / 2.4], axis=-1)


def threshold(values: Array) -> float:
    """The value that parts `values`, of any shape, into the two classes of least variance (Otsu 1979)."""
    top = np.quantile(values, 0.995)
    counts, edges = np.histogram(np.minimum(values, top), GREYS)
    centres = (edges[1:] + edges[:-1]) / 2
    below = np.cumsum(counts)
    above = below[-1] - below
    sums = np.cumsum(counts * centres)
    with np.errstate(divide="ignore", invalid="ignore"):
        between = below * above * (sums / below - (sums[-1] - sums) / above) ** 2
    return float(edges[1:][np.nanargmax(between)])
