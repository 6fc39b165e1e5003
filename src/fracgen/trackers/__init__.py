"""Point trackers: one file each, chosen by name.

A module has `Settings`, a dataclass of its fields, and `build(settings)`, which returns a function
`track(clip, queries, t0) -> (tracks, visible)`: queries (N, 2) float [px, x right and y down] in frame t0,
tracks (T, N, 2) float64, visible (T, N) bool.
"""

NEEDED = ("Settings", "build")
