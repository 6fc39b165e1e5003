"""Physics maps, one module each: `quantity(frame, camera_axes) -> [N, CHANNELS]` and how to show it.

A map module has CHANNELS; UNIT and LABEL, for people; SCALE, the value shown as 1, or None for the largest of the
clip. `codec` turns recorded maps into video in [0, 1] and back; it is not a map, so its file has an underscore.
"""

from fracsim import codec

__all__ = ["codec"]
