"""What the requests of one server share, and how a request finds its tab."""

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from fastapi import Depends, Request

import fracsim.photo
from fracgen.annotation import commands
from fracgen.annotation.album import Album
from fracgen.annotation.jobs import Queue
from fracgen.annotation.preview import Size
from fracgen.annotation.sessions import Cut, Session, Sessions

Command = Callable[[commands.Task], list[str]]


@dataclass(frozen=True)
class Settings:
    """What the page works with."""

    album: Album = Album()
    size: Size = Size()
    simulate: Command = commands.simulate
    generate: Command | None = None
    """None where there is no checkpoint."""
    cut: Cut = fracsim.photo.cut


@dataclass
class Place:
    """What all requests share."""

    settings: Settings
    folder: Path = field(default_factory=lambda: Path(tempfile.mkdtemp(prefix="fracgen-annotate-")))
    queue: Queue = field(default_factory=Queue)

    def __post_init__(self) -> None:
        self.sessions = Sessions(self.folder, self.queue, self.settings.cut)

    def close(self) -> None:
        """End all jobs and remove all files."""
        self.queue.close()
        shutil.rmtree(self.folder, ignore_errors=True)


def place_of(request: Request) -> Place:
    """What the requests of a server share."""
    place: Place = request.app.state.place
    return place


Shared = Annotated[Place, Depends(place_of)]


def session_of(token: str, place: Shared) -> Session:
    """The session that the path of a request names; raises UnknownError."""
    return place.sessions.find(token)


Tab = Annotated[Session, Depends(session_of)]
