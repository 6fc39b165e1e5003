"""Reads a video file of any kind, through the ffmpeg that imageio-ffmpeg ships."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fracsim.records import Array

LARGEST = 2**31
"""Bytes of a decoded video above which it is refused: it is no clip of a few seconds."""


class Film(NamedTuple):
    """A decoded video."""

    rgb: Array
    """Colour, (T, H, W, 3) uint8."""
    fps: float
    """Frames a second at which it is played [1/s]; not of simulated time."""


def read(path: Path) -> Film:
    """All frames of a video file; raises ValueError when it cannot be read, is empty or is too long."""
    from imageio_ffmpeg import read_frames

    # Each frame once, whatever its time stamp says: at a constant rate ffmpeg would repeat or drop some.
    stream: Any = read_frames(str(path), pix_fmt="rgb24", output_params=["-fps_mode", "passthrough"])
    try:
        about = next(stream)
        width, height = about["size"]
        most = max(LARGEST // (3 * width * height), 1)
        frames = []
        for data in stream:
            frames.append(np.frombuffer(data, np.uint8).reshape(height, width, 3))
            if len(frames) > most:
                raise ValueError(f"{path.name} has more than {most} frames of {width} x {height} px: cut it to the "
                                 "clip that is to be scored")  # fmt: skip
    except (OSError, RuntimeError, StopIteration, KeyError) as error:
        raise ValueError(f"{path.name} cannot be read as a video: {_first(error)}") from None
    finally:
        stream.close()
    if not frames:
        raise ValueError(f"{path.name} has no frames")
    return Film(np.stack(frames), float(about["fps"]))


def _first(error: BaseException) -> str:
    """What an error says, in a line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return (lines[-1] if lines else type(error).__name__)[:200]
