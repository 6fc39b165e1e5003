"""From a scene to a sample on disk: object -> particles -> frames -> pictures -> files."""

from pathlib import Path

import numpy as np

from fracsim import backend, registry, sample
from fracsim.asset.build import build
from fracsim.records import Frame, Particles
from fracsim.render.film import Film
from fracsim.run import console
from fracsim.run.interrupt import Interrupt
from fracsim.run.stopwatch import Stopwatch
from fracsim.sample import Writer
from fracsim.scene.vocab import Scene
from fracsim.solve.march import SimulationError
from fracsim.solve.setup import ready
from fracsim.solve.simulator import Simulator


def run(scene: Scene) -> Path:
    """Run a scene and return the folder of its sample; a whole sample that is already there is not made again.

    Raises ValueError, OSError or RuntimeError with one clear message; what was rendered until then is kept in
    `<id>.incomplete`.
    """
    done = sample.find(scene)
    if done is not None and not scene.output.overwrite:
        console.already(done)
        return done
    check_names(scene)
    backend.start(scene.backend)
    ready(scene)
    watch = Stopwatch()
    film = Film(scene)
    with Writer(scene, film.size, film.describe(), scene.capture.maps, scene.capture.rgb) as writer:
        with console.progress(scene) as progress:
            with watch("prepare"):
                particles = build(scene.asset, scene.solver.spacing, scene.seed)
            simulator = Simulator(scene, particles, progress.substeps)
            reason = _shoot(scene, simulator, film, writer, watch, progress)
        report = simulator.report
        path = writer.finish(report.summary(), vars(report.history), watch.seconds, not reason, reason)
    console.table(scene, report.summary(), watch.seconds, path, writer.frames)
    if reason == console.INTERRUPTED:
        raise KeyboardInterrupt
    if reason:
        raise SimulationError(f"{reason} Kept: {writer.frames} of {scene.capture.frames} frames, in {path}.")
    return path


def check_names(scene: Scene) -> None:
    """Load the plug-ins that a scene names; raises ValueError for an unknown one."""
    registry.load("fracsim.constitutive", scene.material.law, "material.law")
    registry.load("fracsim.damage", scene.fracture.law, "fracture.law")
    for name in scene.capture.maps:
        registry.load("fracsim.maps", name, "capture.maps")


def _shoot(
    scene: Scene, simulator: Simulator, film: Film, writer: Writer, watch: Stopwatch, progress: console.Progress
) -> str:
    """Simulate, render and write all frames; returns why it ended early, or "". Raises when no frame was written."""
    tracked = np.zeros(0, int)
    frames = iter(watch.timed("simulate", simulator.frames()))
    try:
        with Interrupt() as interrupt:
            for frame in frames:
                with watch("render"):
                    picture = film.shoot(frame, simulator.particles)
                if frame.index == 0:
                    tracked = film.choose_tracks(frame, simulator.particles, picture)
                    writer.track(tracked)
                with watch("write"):
                    tracks = film.tracks(frame, tracked, picture) if len(tracked) else None
                    writer.add(frame.index, picture.rgb, picture.alpha, picture.maps, tracks)
                    _extras(scene, writer.folder, frame, simulator.particles)
                progress.frame(frame.index)
                interrupt.check()
    except (SimulationError, KeyboardInterrupt) as error:
        if not writer.frames:
            raise
        return str(error) or console.INTERRUPTED
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
