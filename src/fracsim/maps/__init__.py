"""Physics maps, one module each: `quantity(frame, camera_axes) -> [N, CHANNELS]` and how to show it.

A map module has CHANNELS; UNIT and LABEL, for people; SCALE, the value shown as 1, or None for the largest of the
clip. `fracsim.codec` turns recorded maps into video in [0, 1] and back.
"""
