"""A sample as one picture or animation that any program shows: PNG, GIF or WebP made from its strip."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from fracsim.records import Array
from fracsim.sample import schema
from fracsim.sample.reader import Sample
from fracsim.sample.video import FPS

COLUMN = 6
"""Frames of a PNG, one above the other."""


def save(sample: Sample, path: Path | str, width: int = 1000, step: int = 2) -> Path:
    """Write strip.mp4 as an animation (GIF, WebP; every `step`-th frame) or as COLUMN frames one above the other (PNG).

    `width` is that of the file [px]; a strip is never enlarged. Raises ValueError for another suffix, for a sample
    without strip, and for a width or step below 1.
    """
    path = Path(path).expanduser()
    save_as = _WRITERS.get(path.suffix.lower())
    if save_as is None:
        raise ValueError(f"{path} is no picture that can be written: its name must end in {', '.join(_WRITERS)}.")
    if width < 1 or step < 1:
        raise ValueError(f"width={width} and step={step} must be at least 1.")
    if not (sample.path / schema.STRIP).is_file():
        raise ValueError(f"{sample.path} has no {schema.STRIP}: it was made with capture.strip=false, or not finished.")
    path.parent.mkdir(parents=True, exist_ok=True)
    save_as(path, frames(sample), width, step)
    return path


def frames(sample: Sample) -> list[Array]:
    """The pictures of strip.mp4, [H, W, 3] uint8 each."""
    import imageio.v3 as iio

    return list(iio.imiter(sample.path / schema.STRIP))


def _small(picture: Array, width: int) -> Image.Image:
    image = Image.fromarray(picture)
    if image.width <= width:
        return image
    return image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)


def _animate(path: Path, pictures: list[Array], width: int, step: int) -> None:
    """An endless animation at the speed of the strip."""
    first, *others = (_small(picture, width) for picture in pictures[::step])
    more = {"quality": 70, "method": 4} if path.suffix.lower() == ".webp" else {"optimize": True}
    first.save(path, save_all=True, append_images=others, duration=round(1000 * step / FPS), loop=0, **more)


def _column(path: Path, pictures: list[Array], width: int, step: int) -> None:
    """Frames at equal distances, the first and the last among them."""
    chosen = np.unique(np.linspace(0, len(pictures) - 1, COLUMN).round().astype(int))
    rows = [np.asarray(_small(pictures[k], width)) for k in chosen]
    Image.fromarray(np.concatenate(rows)).save(path, optimize=True)


_WRITERS: dict[str, Callable[[Path, list[Array], int, int], None]] = {
    ".png": _column,
    ".gif": _animate,
    ".webp": _animate,
}
