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
RARE = 0.12
"""Share of the border below which a colour may be that of an object which touches it."""
NOISE = 1.5
"""A pixel is no ground if it is as many times farther from the ground's colours than nearly all of the border."""
GREYS = 256


def cut(photo: Photo) -> Array:
    """Where the distance from the colours of the border is more than theirs, (H, W) bool."""
    away = distance(photo)
    mask = Image.fromarray((away > level(away)).astype(np.float32)).resize(photo.size, Image.Resampling.BILINEAR)
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
    means, of = kmeans2(border, min(GROUNDS, len(np.unique(border, axis=0))), minit="++", rng=0)
    spread = np.sqrt(np.mean((border - means[of]) ** 2)) + 2.0
    away = np.full(values.shape[:2], np.inf)
    for k in np.flatnonzero(np.bincount(of) >= RARE * len(of)):
        away = np.minimum(away, np.linalg.norm(values - means[k], axis=2))
    out: Array = away / spread
    return out


def level(away: Array) -> float:
    """The distance, of those in `away` (h, w), from which on a pixel is no ground.

    It is that of nearly all of the border and a little more, but at most Otsu's threshold: of a busy ground.
    """
    noise = float(np.quantile(away[ring(*away.shape)], 0.9))
    return min(threshold(away), max(NOISE * noise, 3.0))


def _opponent(rgb: Array) -> Array:
    """Half the brightness, red minus green, and blue minus yellow of colours (..., 3)."""
    r, g, b = np.moveaxis(rgb, -1, 0)
    return np.stack([(r + g + b) / 6, (r - g) / 1.4, (2 * b - r - g) / 2.4], axis=-1)


def threshold(values: Array) -> float:
    """The value that parts `values`, of any shape, into the two classes of least variance (Otsu 1979).

    Where several do, as in a gap, it is the middle one; where all values are equal, none is above it.
    """
    if np.ptp(values) == 0:
        return float(values.max())
    top = np.quantile(values, 0.995)
    counts, edges = np.histogram(np.minimum(values, top), GREYS)
    centres = (edges[1:] + edges[:-1]) / 2
    below = np.cumsum(counts)
    above = below[-1] - below
    sums = np.cumsum(counts * centres)
    with np.errstate(divide="ignore", invalid="ignore"):
        between = below * above * (sums / below - (sums[-1] - sums) / above) ** 2
    best = between >= np.nanmax(between) * (1 - 1e-9)
    return float(edges[1:][best].mean())
