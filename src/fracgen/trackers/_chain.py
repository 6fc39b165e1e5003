"""Tracks from steps between neighbouring frames, each checked by the step back. Needs OpenCV."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from fracgen.evaluation.clip import Clip
from fracgen.evaluation.weights import MissingWeightsError
from fracsim.records import Array

Step = Callable[[Array, Array, Array], tuple[Array, Array]]
"""step(grey, next grey, points (N, 2)) -> the points in the next frame (N, 2), and whether each was found (N,)."""


def opencv(tracker: str) -> Any:
    """The module cv2; raises MissingWeightsError when it is not installed."""
    try:
        import cv2
    except ImportError as error:
        text = (
            f"the tracker {tracker} needs OpenCV: pip install 'fracsim[metrics]', or choose simulator or tracks_file."
        )
        raise MissingWeightsError(text) from error
    return cv2


def chain(
    clip: Clip, queries: Array, window: tuple[int, int], step: Step, side: int, tolerance: float
) -> tuple[Array, Array]:
    """Follow queries (N, 2) [px] through the frames t0 to t1 = `window`, as a Tracker returns it.

    Pictures whose longer side is below `side` are enlarged to it, both sides alike. A point is lost for good when a
    step does not find it, when the step back ends farther away than `tolerance` times the longer side, or when it
    leaves the picture.
    """
    t0, t1 = window
    frames, scale = pictures(clip.rgb[t0 : t1 + 1], side)
    height, width = frames[0].shape
    # OpenCV has the centre of the first pixel at (0, 0).
    points = np.asarray(queries, np.float64) * scale - 0.5
    tracks, seen = [points], [np.ones(len(points), bool)]
    for here, there in pairwise(frames):
        moved, found = step(here, there, points)
        back, found_back = step(there, here, moved)
        near = np.linalg.norm(back - points, axis=1) <= tolerance * max(height, width)
        inside = ((moved >= -0.5) & (moved <= (width - 0.5, height - 0.5))).all(axis=1)
        points = moved
        tracks.append(points)
        seen.append(seen[-1] & found & found_back & near & inside)
    return (np.stack(tracks) + 0.5) / scale, np.stack(seen)


def pictures(rgb: Array, side: int) -> tuple[list[Array], float]:
    """Frames (T, H, W, 3) uint8 as grey ones (H', W') uint8, enlarged if their longer side is below `side`; the factor.

    The factor is a whole number, so that a pixel becomes a square of pixels.
    """
    import cv2

    factor = max(1, -(-side // max(rgb.shape[1:3])))
    grey = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in rgb]
    if factor > 1:
        grey = [cv2.resize(frame, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC) for frame in grey]
    return [np.asarray(frame) for frame in grey], float(factor)
