"""Stress: the von Mises measure of the stress that the damaged material carries."""

import numpy as np

from fracsim.records import J_MIN, Array, Frame

CHANNELS = 1
UNIT = "Pa"
LABEL = "stress"
SCALE: float | None = None


def quantity(frame: Frame, camera_axes: Array) -> Array:
    """Von Mises stress sqrt(3/2 s : s) [Pa], (N, 1), with s the deviator of the degraded Cauchy stress tau / J.

    J counts as J_MIN where it is smaller. `camera_axes`, (3, 3), plays no part.
    """
    xx, xy, xz, _, yy, yz, _, _, zz = np.ascontiguousarray(frame.tau.reshape(-1, 9).T)
    normal = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
    shear = 3 * (xy**2 + yz**2 + xz**2)
    return np.asarray(np.sqrt(normal + shear) / _volume_ratio(frame.F))[:, None]


def _volume_ratio(F: Array) -> Array:
    """det F of F (N, 3, 3), at least J_MIN, (N,)."""
    a, b, c, d, e, f, g, h, i = np.ascontiguousarray(F.reshape(-1, 9).T)
    J = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return np.asarray(np.maximum(J, J.dtype.type(J_MIN)))
