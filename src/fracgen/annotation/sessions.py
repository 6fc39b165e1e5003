"""What each tab works on: its picture and its cut-out, in a folder of its own; two tabs share nothing."""

import secrets
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np
from PIL import Image

import fracsim.photo
from fracgen.annotation import uploads
from fracgen.annotation.jobs import Queue
from fracsim.photo import Photo, cutting
from fracsim.photo.outline import Outline
from fracsim.records import Array
from fracsim.scene.vocab import Asset

MOST = 24
"""Tabs that are remembered; the one that was silent longest makes room."""
SHOWN = 1280
"""Longest edge of the picture that the page shows [px]."""
Cut = Callable[[Photo], Array]
"""Finds the object in a photo, (H, W) bool; raises ValueError when there is none."""


class UnknownError(Exception):
    """A session, a picture or a job is not there, or no longer."""


@dataclass(frozen=True)
class Opened:
    """A picture that is being worked on."""

    number: int
    path: Path
    """The file that is simulated: of the album, or one that this server has made of an upload."""
    folder: Path
    index: int | None
    """Its number in the album; None for an upload."""
    size: tuple[int, int]
    """Width and height [px]."""
    shown: tuple[int, int]
    """Width and height of the picture that the page shows [px]."""

    @property
    def mask(self) -> Path:
        """The cut-out, white on the object."""
        return self.folder / "mask.png"


@dataclass(eq=False)
class Session:
    """One tab."""

    folder: Path
    cut: Cut
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    heard: float = field(default_factory=time.monotonic)
    opened: Opened | None = None
    lock: Any = field(default_factory=RLock)
    """Held while picture or cut-out change."""
    _count: int = 0

    @property
    def picture(self) -> Opened:
        """What is open; raises UnknownError when nothing is."""
        if self.opened is None:
            raise UnknownError("There is no picture yet: choose one.")
        return self.opened

    def take(self, content: bytes) -> dict[str, Any]:
        """Open an upload; raises ValueError for bytes that are no picture, or too large."""
        uploads.check_picture(content)
        with self.lock:
            folder = self._new_folder()
            given = folder / "upload"
            given.write_bytes(content)
            path = folder / "object.png"  # the name stands in the caption
            try:
                with uploads.DECODING:
                    photo = _load(given, "The picture")
                    _file(photo).save(path, compress_level=1)
            finally:
                given.unlink()
            return self._open(path, folder, None, photo, self.cut)

    def choose(self, path: Path, index: int, mask: Path | None = None) -> dict[str, Any]:
        """Open an image of the album, with the cut-out in a file if there is one.

        Raises ValueError for an image that is no picture, or too large.
        """
        try:
            uploads.check_picture(path.read_bytes())
        except OSError as error:
            raise ValueError(f"{path.name} cannot be read: {error.strerror}.") from None
        with self.lock:
            with uploads.DECODING:
                photo = _load(path, path.name)
            find = self.cut if mask is None else partial(cutting.of_file, str(mask))
            return self._open(path, self._new_folder(), index, photo, find)

    def paint(self, content: bytes) -> dict[str, Any]:
        """Take a cut-out that was painted, a PNG that is white on the object; what the page needs to know of it.

        Raises ValueError for bytes that are no picture of the size that the page shows.
        """
        uploads.check_picture(content)
        with self.lock:
            there = self.picture
            part = there.folder / "painted.png"
            part.write_bytes(content)
            try:
                _painted(part, there).save(there.mask, compress_level=1)
            finally:
                part.unlink()
            return self.cutout()

    def cut_again(self) -> dict[str, Any]:
        """Forget what was painted, and find the object in the picture again."""
        with self.lock:
            there = self.picture
            return self._cut(there, _load(there.path, there.path.name), self.cut)

    def cutout(self, note: str = "") -> dict[str, Any]:
        """Where the object is, in widths and heights of the picture; None and a note where there is none."""
        there = self.picture
        try:
            photo = Photo(np.zeros((there.size[1], there.size[0], 3), np.uint8), None, "the picture")
            outline = Outline(photo, cutting.of_file(str(there.mask), photo))
        except ValueError:
            return {"object": None, "note": note or "The cut-out is empty, or all of the picture: paint the object."}
        centre, extent = outline.centre / there.size, outline.extent
        found = {"centre": centre.tolist(), "extent": extent / there.size[0], "metres": Asset().size}
        return {"object": found, "note": note}

    def _new_folder(self) -> Path:
        """A folder for the next picture."""
        self._count += 1
        folder = self.folder / f"picture-{self._count}"
        folder.mkdir(parents=True)
        return folder

    def _open(self, path: Path, folder: Path, index: int | None, photo: Photo, find: Cut) -> dict[str, Any]:
        """Work on a picture from now on; all that the page needs to know of it."""
        shown = _on_white(photo)
        shown.thumbnail((SHOWN, SHOWN), Image.Resampling.LANCZOS)
        shown.save(folder / "shown.jpg", quality=90)
        opened = Opened(self._count, path, folder, index, photo.size, shown.size)
        cutout = self._cut(opened, photo, find)
        return {"number": opened.number, "index": index, "size": opened.size, "shown": opened.shown, **cutout}

    def _cut(self, there: Opened, photo: Photo, find: Cut) -> dict[str, Any]:
        """Find the object, or nothing, and open the picture with it."""
        try:
            with uploads.DECODING:
                mask, note = find(photo), ""
        except ValueError as error:
            mask, note = np.zeros((photo.size[1], photo.size[0]), bool), f"No object was found, paint it: {error}"
        Image.fromarray(np.where(mask, 255, 0).astype(np.uint8)).save(there.mask, compress_level=1)
        self.opened = there
        return self.cutout(note)


def _load(path: Path, name: str) -> Photo:
    """The photo in a file, which errors call `name`."""
    try:
        return fracsim.photo.load(path)
    except ValueError as error:
        raise ValueError(str(error).replace(f"asset.path={path}", name)) from None


def _painted(path: Path, there: Opened) -> Image.Image:
    """A cut-out in the size of the picture; raises ValueError for one of another size than the page shows."""
    with Image.open(path) as image:
        if image.size != there.shown:
            raise ValueError(f"The cut-out has {image.size} pixels instead of {there.shown}.")
        try:
            grey: Image.Image = image.convert("L")
        except (OSError, SyntaxError) as error:  # what Pillow raises for broken pixels
            raise ValueError(f"The cut-out cannot be read ({error}): paint it again.") from None
    return grey.resize(there.size, Image.Resampling.BILINEAR)


def _file(photo: Photo) -> Image.Image:
    """A photo as a picture with its transparent parts, if it has any."""
    colour = Image.fromarray(photo.rgb)
    if photo.alpha is not None:
        colour.putalpha(Image.fromarray(np.rint(255 * photo.alpha).astype(np.uint8)))
    return colour


def _on_white(photo: Photo) -> Image.Image:
    """A photo in RGB, transparent parts white."""
    image = _file(photo).convert("RGBA")
    return Image.alpha_composite(Image.new("RGBA", image.size, "white"), image).convert("RGB")


class Sessions:
    """All tabs by their tokens, below one folder."""

    def __init__(self, folder: Path, queue: Queue, cut: Cut) -> None:
        self._folder, self._queue, self._cut = folder, queue, cut
        self._open: dict[str, Session] = {}
        self._lock = RLock()

    def begin(self) -> Session:
        """A new session; when there are too many, the one that was silent longest ends."""
        with self._lock:
            session = Session(self._folder / secrets.token_hex(8), self._cut)
            session.folder.mkdir(parents=True)
            self._open[session.token] = session
            silent = sorted(self._open.values(), key=lambda s: s.heard)[: max(0, len(self._open) - MOST)]
        for old in silent:
            self.end(old.token)
        return session

    def find(self, token: str) -> Session:
        """The session of a token; raises UnknownError."""
        with self._lock:
            session = self._open.get(token)
        if session is None:
            raise UnknownError("This page is no longer known here: reload it.")
        session.heard = time.monotonic()
        return session

    def end(self, token: str) -> None:
        """Cancel the jobs of a session and remove its files."""
        with self._lock:
            session = self._open.pop(token, None)
        if session is not None:
            self._queue.drop(token)
            shutil.rmtree(session.folder, ignore_errors=True)
