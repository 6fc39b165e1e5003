"""Physics maps, one module each.

`quantity(frame, camera_axes)` gives the map's value at each particle, (N, CHANNELS). The rows of `camera_axes`, (3, 3),
are the camera's right, down and ahead in world coordinates. CHANNELS, UNIT and LABEL describe the value. SCALE is the
value shown as 1, or None for the largest value of the clip. `fracsim.codec` turns recorded maps into video and back.
"""
