"""Strain: the size of the Green-Lagrange tensor."""

import numpy as np

from fracsim.records import Array, Frame

CHANNELS = 1
UNIT = "1"
LABEL = "strain"
SCALE: float | None = None


def quantity(frame: Frame, camera_axes: Array) -> Array:
    """Frobenius norm of E = (F^T F - I) / 2 (Eq. 2), (N, 1); `camera_axes`, (3, 3), plays no part."""
    # One contiguous row a component. I is subtracted before squaring: in float32 traces of F^T F would cancel.
    f = np.ascontiguousarray(frame.F.reshape(-1, 9).T).reshape(3, 3, -1)
    twice = np.einsum("kin,kjn->ijn", f, f)
    twice[(0, 1, 2), (0, 1, 2)] -= 1
    return np.asarray(0.5 * np.sqrt(np.einsum("ijn,ijn->n", twice, twice)))[:, None]
