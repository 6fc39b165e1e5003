"""From a scene to a sample on disk: object -> particles -> frames -> pictures -> files."""

from pathlib import Path

import numpy as np

from fracsim import backend
from fracsim.asset.build import build_of
from fracsim.entry.interrupt import Interrupt, interrupted
from fracsim.photo.stage import staged
from fracsim.records import Frame, Particles
from fracsim.render.film import Film
from fracsim.run.outcome import Outcome, health
from fracsim.run.stopwatch import Stopwatch
from fracsim.run.watcher import Watcher
from fracsim.sample import Writer, find, header_of, scene_id
from fracsim.sample.origin import changes
from fracsim.sample.schema import read_meta
from fracsim.scene.knob import check_names
from fracsim.scene.vocab import Scene
from fracsim.solve.march import SimulationError
from fracsim.solve.setup import Ready, ready
from fracsim.solve.simulator import Simulator

FIRST = "compiling kernels, this takes about a minute the first time"
INTERRUPTED = "interrupted by the user"
EXPECTED = (KeyboardInterrupt, ValueError, OSError, RuntimeError)
"""Errors that are an outcome of a run."""


def run(scene: Scene, watch: Watcher | None = None) -> Outcome:
    """Run a scene and write its sample; a whole sample that is already there is not made again.

    Prints nothing. A bad scene, a full disk, an unstable simulation and Ctrl-C are outcomes, not errors;
    `outcome.sample()` raises for them.
    """
    watch = watch or Watcher()
    try:
        scene = staged(scene)
        existing = _existing(scene)
        if existing:
            return existing
        check_names(scene)
        if backend.first_use():
            watch.note(FIRST)
        backend.start(scene.backend)
        prepared = ready(scene)
        film = Film(scene)
        writer = Writer(header_of(scene), scene.output)
    except EXPECTED as error:
        return _stopped(error)
    try:
        with writer:
            return _record(scene, prepared, film, writer, watch)
    except EXPECTED as error:
        return _stopped(error, writer)


def _existing(scene: Scene) -> Outcome | None:
    """The outcome of a scene whose sample is there, unless it is to be made again."""
    path = find(scene.output, scene_id(scene))
    if path is None or scene.output.overwrite:
        return None
    meta = read_meta(path)
    return Outcome("existing", path, changes(scene, meta), meta["report"], meta["seconds"], meta["frames"])


def _stopped(error: BaseException, writer: Writer | None = None) -> Outcome:
    """The outcome of an error, and of the frames that the writer has kept."""
    frames = writer.frames if writer else 0
    path = writer.folder if writer and frames else None
    if isinstance(error, KeyboardInterrupt) or interrupted():
        return Outcome("interrupted", path, INTERRUPTED, frames=frames)
    return Outcome("failed", path, str(error), frames=frames)


def _record(scene: Scene, prepared: Ready, film: Film, writer: Writer, watch: Watcher) -> Outcome:
    """Prepare the object, record all frames and finish the sample; raises when no frame was written."""
    timer = Stopwatch()
    with timer("prepare"):
        particles = build_of(scene)
    simulator = Simulator(scene, particles, watch.substeps, prepared)
    reason = _shoot(scene, simulator, film, writer, timer, watch)
    report, seconds = simulator.report.summary(), dict(timer.seconds)
    report["warnings"] += film.warnings()
    path = writer.finish(report, vars(simulator.report.history), seconds, reason)
    if reason == INTERRUPTED:
        return Outcome("interrupted", path, reason, report, seconds, writer.frames)
    if reason:
        kept = f"{reason} Kept: {writer.frames} of {scene.capture.frames} frames, in {path}."
        return Outcome("failed", path, kept, report, seconds, writer.frames)
    status, doubts = health(report)
    return Outcome(status, path, doubts, report, seconds, writer.frames)


def _shoot(scene: Scene, simulator: Simulator, film: Film, writer: Writer, timer: Stopwatch, watch: Watcher) -> str:
    """Simulate, render and write all frames; returns why it ended early, or "". Raises when no frame was written."""
    tracked = np.zeros(0, int)
    frames = iter(timer.timed("simulate", simulator.frames()))
    try:
        with Interrupt() as interrupt:
            for frame in frames:
                with timer("render"):
                    picture = film.shoot(frame, simulator.particles)
                if frame.index == 0:
                    tracked = film.choose_tracks(frame, simulator.particles, picture)
                    writer.track(tracked)
                with timer("write"):
                    tracks = film.tracks(frame, tracked, picture) if len(tracked) else None
                    writer.add(frame.index, picture.rgb, picture.alpha, picture.maps, tracks)
                    _extras(scene, writer.folder, frame, simulator.particles)
                watch.frame(frame.index)
                interrupt.check()
    except (SimulationError, KeyboardInterrupt) as error:
        if not writer.frames:
            raise
        return str(error) or INTERRUPTED
    return ""


def _extras(scene: Scene, folder: Path, frame: Frame, particles: Particles) -> None:
    """Files a frame for other programs, on request."""
    if scene.capture.particles:
        (folder / "particles").mkdir(exist_ok=True)
        path = folder / "particles" / f"{frame.index:04d}.npz"
        np.savez(path, x=frame.x, v=frame.v, F=frame.F, tau=frame.tau, d=frame.d)
    if scene.capture.gaussians:
        from fracsim.asset import ply

        (folder / "gaussians").mkdir(exist_ok=True)
        ply.write(folder / "gaussians" / f"{frame.index:04d}.ply", *Film.gaussians(frame, particles))
