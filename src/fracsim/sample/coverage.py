"""Maps as they are stored, the quantity times its coverage, and the quantity itself."""

import numpy as np

from fracsim.records import Array

FAINT = np.float32(0.05)
"""Coverage below which a pixel is too faint to be measured: there a quotient would show the rounding of the codes."""


def over_alpha(values: Array, alpha: Array) -> Array:
    """The quantity itself, [..., C] float32: a map `values` [..., C] over its coverage `alpha` [...].

    It is the mean of the quantity over the Gaussians of a pixel, each by its part in the picture; exactly 0 where alpha
    is below FAINT.
    """
    seen = (alpha >= FAINT)[..., None]
    return np.divide(values, alpha[..., None], out=np.zeros_like(values, np.float32), where=seen, dtype=np.float32)
