"""What the network will see of a condition: its numbers, its loading as a video, and its picture."""

import io
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from fracgen import conditioning
from fracgen.sampling import picture
from fracsim.records import Array
from fracsim.scene.condition import Condition

SHOWN = 21
"""Most frames of a clip that the preview shows, the first and the last among them."""
LONGEST = 416
"""Longest edge of the preview [px]."""
SECONDS = 2.0
"""Time that the preview takes."""


@dataclass(frozen=True)
class Size:
    """A clip of the model."""

    frames: int = 81
    height: int = 480
    width: int = 832
    fps: float = 0.0
    """Frames a second of simulated time, whatever rate a condition has; 0 = that of the condition."""


def numbers(condition: Condition) -> dict[str, Any]:
    """The numbers in [-1, 1] by name, and the fields that lie outside of what the network knows."""
    values = conditioning.scalars(condition, "clamp").tolist()
    known = conditioning.physical(values)
    return {
        "numbers": dict(zip(conditioning.SCALARS, values, strict=True)),
        "outside": [n for n in conditioning.LIMITS if not math.isclose(known[n], getattr(condition, n), rel_tol=1e-4)],
    }


def box(photo: tuple[int, int], size: Size, fit: str) -> list[float]:
    """Where the model's picture lies in a photo of `photo` px: left, top, width and height, in widths and heights."""
    at = picture.place(photo, size.width, size.height, fit)
    return [-at.left / at.width, -at.top / at.height, size.width / at.width, size.height / at.height]


def force(condition: Condition, photo: tuple[int, int], size: Size, fit: str) -> Array:
    """The loading as the model sees it, some frames in small, (F, h, w) uint8."""
    shown = force_size(size)
    at = picture.place(photo, size.width, size.height, fit)
    corner, extent = (at.left / size.width, at.top / size.height), (at.width / size.width, at.height / size.height)
    timed = replace(condition, fps=size.fps or condition.fps)
    paths = picture.moved(timed, corner, extent).paths(size.frames, *shown)
    chosen = np.round(np.linspace(0, size.frames - 1, min(SHOWN, size.frames))).astype(int)
    video = conditioning.blobs(paths[chosen], *shown)
    return np.asarray(np.rint(255 * video[..., 0]), np.uint8)


def force_size(size: Size) -> tuple[int, int]:
    """Width and height of the preview [px]."""
    factor = min(1.0, LONGEST / max(size.width, size.height))
    return max(1, round(size.width * factor)), max(1, round(size.height * factor))


def animation(frames: Array, once: bool = False) -> bytes:
    """An animated PNG of grey pictures (F, h, w) uint8, shown once or without end."""
    first, *rest = (Image.fromarray(frame) for frame in frames)
    out = io.BytesIO()
    first.save(out, "PNG", save_all=True, append_images=rest, duration=1000 * SECONDS / len(frames), loop=int(once))
    return out.getvalue()


def reference(path: Path, size: Size, fit: str) -> bytes:
    """The picture that the model sees, a JPEG; raises ValueError for a file that is no picture."""
    out = io.BytesIO()
    Image.fromarray(picture.load(path, size.width, size.height, fit).pixels).save(out, "JPEG", quality=88)
    return out.getvalue()
