"""Physics maps, one module each.

`quantity(frame, camera_axes)` gives the map's value at each particle, (N, CHANNELS). The rows of `camera_axes`, (3, 3),
are the camera's right, down and ahead in world coordinates. CHANNELS, UNIT and LABEL describe the value. SCALE is the
value shown as 1, or None for the largest value of the clip. A pixel of the picture holds the quantity times its
coverage (Eq. 6); `fracsim.sample` gives both this and the quantity itself. `fracsim.codec` turns recorded maps into
video and back.
"""

from types import ModuleType

from fracsim import registry
from fracsim.records import Array, Frame

NEEDED = ("CHANNELS", "UNIT", "LABEL", "SCALE", "quantity")
"""What a map module must have."""


def load(name: str) -> ModuleType:
    """The module of a map; raises ValueError for an unknown map, or one that lacks a name of NEEDED."""
    return registry.load("fracsim.maps", name, "capture.maps")


def values(name: str, module: ModuleType, frame: Frame, camera_axes: Array) -> Array:
    """The quantity of a map, (N, CHANNELS); `camera_axes`, (3, 3), has right, down and ahead as rows.

    Raises ValueError naming the map when it returns another shape.
    """
    out: Array = module.quantity(frame, camera_axes)
    wanted = (len(frame.x), module.CHANNELS)
    if out.shape != wanted:
        raise ValueError(
            f"capture.maps={name}: quantity() in {module.__file__} returns shape {out.shape}, expected {wanted} "
            "(particles, CHANNELS): return one column a channel, as d[:, None]."
        )
    return out
