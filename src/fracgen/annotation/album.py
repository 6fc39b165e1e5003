"""The images that the page was started with: a client names them by number, never by path."""

import os
from dataclasses import dataclass
from pathlib import Path

from fracsim.scene import condition
from fracsim.scene.condition import Condition

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".gif", ".tif", ".tiff", ".heic", ".heif", ".avif")
"""Files of a folder that count as images."""
MASK = ".mask.png"
"""Ending of a cut-out beside an image, which is no image of its own."""


@dataclass(frozen=True)
class Album:
    """Images by number, each with a condition file beside it, of the same name with the ending .json."""

    images: tuple[Path, ...] = ()

    def file(self, index: int) -> Path:
        """The condition file of an image."""
        return self.images[index].with_suffix(".json")

    def mask(self, index: int) -> Path | None:
        """The cut-out beside an image, if there is one."""
        file = self.images[index].with_suffix(MASK)
        return file if file.is_file() else None

    def saved(self, index: int) -> Condition | None:
        """The condition beside an image, None if there is none; raises ValueError for a file that is no condition."""
        return condition.load(self.file(index)) if self.file(index).exists() else None

    def save(self, index: int, value: Condition) -> Path:
        """Write the condition beside an image, whole or not at all.

        Raises ValueError where another file has that name, OSError where the folder cannot be written.
        """
        file = self.file(index)
        try:
            self.saved(index)
        except ValueError as error:
            raise ValueError(f"{file.name} is not overwritten: {error} Move that file away first.") from None
        part = file.with_name(f".{file.name}.{os.getpid()}.part")
        try:
            condition.save(value, part)
            os.replace(part, file)
        finally:
            part.unlink(missing_ok=True)
        return file


def opened(given: str) -> Album:
    """The album of an image, of a folder of images, or of nothing.

    Raises ValueError for a path that is neither, a folder without images, and images that would share a condition file.
    """
    if not given:
        return Album()
    path = Path(given).expanduser()
    if path.is_file():
        return Album((path,))
    if not path.is_dir():
        raise ValueError(f"{given} is neither an image nor a folder: give the path of one, or nothing.")
    images = tuple(sorted(p for p in path.iterdir() if _is_image(p)))
    if not images:
        raise ValueError(f"{given} holds no image: put files into it that end with {', '.join(SUFFIXES)}.")
    names: dict[str, Path] = {}
    for image in images:
        other = names.setdefault(image.stem, image)
        if other is not image:
            raise ValueError(f"{given}: {other.name} and {image.name} would share the condition file "
                             f"{image.stem}.json: rename one of them.")  # fmt: skip
    return Album(images)


def _is_image(path: Path) -> bool:
    """Whether a file counts as an image."""
    hidden = path.name.startswith(".") or path.name.lower().endswith(MASK)
    return path.suffix.lower() in SUFFIXES and not hidden and path.is_file()
