"""Running scenes: to a sample on disk, to frames in Python, and the display in a terminal."""
