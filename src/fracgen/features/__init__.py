"""Networks whose features the distances between sets of clips compare: one file each, chosen by name.

A module has `Settings`, a dataclass of its fields, and `build(settings)`, which returns an object with `about()`, its
weights and their sha256, and `__call__(video)`, which turns frames (T, H, W, 3) uint8 into a vector (D,) float64.
"""

NEEDED = ("Settings", "build")
