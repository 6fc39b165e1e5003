"""Point trackers: one file each, chosen by name.

A module has `Settings`, a dataclass of its fields, and `build(settings)`, which returns a
`fracgen.evaluation.tracker.Tracker` or raises ValueError for what is not installed. Positions of points are in pixels
from the top left corner, x right and y down.
"""

NEEDED = ("Settings", "build")
