"""Films the frames of a scene and writes them to its sample."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from fracsim.records import Frame, Particles
from fracsim.render.film import Film
from fracsim.run.stopwatch import Stopwatch
from fracsim.sample import Writer, header_of
from fracsim.scene.vocab import Scene


class Ending(NamedTuple):
    """What is known when the last frame has been handed over; see `Writer.finish`."""

    report: Mapping[str, Any]
    history: Mapping[str, Sequence[float]]
    seconds: Mapping[str, float]
    reason: str = ""
    """Why frames are missing, or ""."""


class Recorded(NamedTuple):
    """A sample that was closed, whole or not."""

    path: Path
    report: dict[str, Any]
    """That of the simulation, with the warnings of the film."""
    frames: int


class Recorder:
    """A scene's sample in the making; a context manager that keeps it as incomplete when an exception passes.

    `timer` gets the seconds of `render` and `write`.
    """

    def __init__(self, timer: Stopwatch) -> None:
        self._timer = timer
        self._tracked = np.zeros(0, int)
        self._writer: Writer | None = None

    @property
    def frames(self) -> int:
        """Frames that were written."""
        return self._writer.frames if self._writer else 0

    @property
    def folder(self) -> Path | None:
        """Where the sample lies."""
        return self._writer.folder if self._writer else None

    def open(self, scene: Scene) -> None:
        """Begin the sample of a scene; raises ValueError for a camera, a map or a folder that cannot be used."""
        self._scene, self._film = scene, Film(scene)
        self._writer = Writer(header_of(scene), scene.output)

    def begin(self, particles: Particles) -> None:
        """Name the object whose frames will come."""
        self._particles = particles

    def add(self, frame: Frame) -> None:
        """Film the next frame and write it.

        Raises ValueError when a map is not finite, OSError naming output.folder when the disk is full.
        """
        particles, film, writer = self._particles, self._film, self._opened
        with self._timer("render"):
            picture = film.shoot(frame, particles)
        if frame.index == 0:
            self._tracked = film.choose_tracks(frame, particles, picture)
            writer.track(self._tracked)
        with self._timer("write"):
            tracks = film.tracks(frame, self._tracked, picture) if len(self._tracked) else None
            writer.add(frame.index, picture.rgb, picture.alpha, picture.maps, tracks)
            self._extras(frame, particles)

    def _extras(self, frame: Frame, particles: Particles) -> None:
        """Files a frame for other programs, on request."""
        if self._scene.capture.particles:
            path = self._extra("particles") / f"{frame.index:04d}.npz"
            np.savez(path, x=frame.x, v=frame.v, F=frame.F, tau=frame.tau, d=frame.d)
        if self._scene.capture.gaussians:
            from fracsim.asset import ply

            ply.write(self._extra("gaussians") / f"{frame.index:04d}.ply", *Film.gaussians(frame, particles))

    def _extra(self, name: str) -> Path:
        folder = self._opened.folder / name
        folder.mkdir(exist_ok=True)
        return folder

    def finish(self, end: Ending) -> Recorded:
        """Close the sample, as `Writer.finish` does; what the film has to warn of joins `report["warnings"]`."""
        report = {**end.report, "warnings": [*end.report["warnings"], *self._film.warnings()]}
        path = self._opened.finish(report, end.history, end.seconds, end.reason)
        return Recorded(path, report, self.frames)

    @property
    def _opened(self) -> Writer:
        assert self._writer is not None, "open() comes first"
        return self._writer

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.__exit__(kind, error, trace)
