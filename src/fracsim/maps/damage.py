"""Damage: how much of its strength the material has lost."""

import numpy as np

from fracsim.records import Array, Frame

CHANNELS = 1
UNIT = "1"
LABEL = "damage"
SCALE: float | None = 1.0


def quantity(frame: Frame, camera_axes: Array) -> Array:
    """Damage d in [0, 1] (Eq. 4), (N, 1); `camera_axes`, (3, 3), plays no part."""
    return np.ascontiguousarray(frame.d)[:, None]
