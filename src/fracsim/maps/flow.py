"""Flow: the velocity of the material as the camera sees it."""

import numpy as np

from fracsim.records import Array, Frame

CHANNELS = 2
UNIT = "m/s"
LABEL = "flow"
SCALE: float | None = None


def quantity(frame: Frame, camera_axes: Array) -> Array:
    """Velocity in the image plane, right and up [m/s], (N, 2).

    The rows of `camera_axes`, (3, 3), are the camera's right, down and ahead in world coordinates.
    """
    right, down = np.asarray(camera_axes, dtype=frame.v.dtype)[:2]
    return np.asarray(frame.v @ np.stack([right, -down], axis=1))
