"""Python's search for unused cycles of objects, for programs that make many objects and few cycles."""

import atexit
import gc

COLLECT = 50_000
"""New objects from one search to the next; 700 by default."""


def collect_rarely() -> None:
    """Search rarely, and not at all when the process ends, which gives all memory back anyway.

    Imports and the syntax trees of kernels make a hundred thousand objects that stay in use: going through them again
    and again took a tenth of the time until the first frame, and 0.3 s of the end.
    """
    gc.set_threshold(COLLECT)
    atexit.register(gc.freeze)
