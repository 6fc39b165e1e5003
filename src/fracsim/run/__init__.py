"""Running scenes: from a scene to a sample on disk, to frames in Python, and what a terminal shows meanwhile."""
