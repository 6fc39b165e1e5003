"""From a scene to a sample on disk: object -> particles -> frames -> pictures -> files."""

import os

from fracsim import backend
from fracsim.asset.build import build_of
from fracsim.entry.interrupt import Interrupt, interrupted
from fracsim.photo.stage import staged
from fracsim.run.beside import Beside
from fracsim.run.outcome import Outcome, health
from fracsim.run.recorder import Ending, Recorder
from fracsim.run.stopwatch import Stopwatch
from fracsim.run.watcher import Watcher
from fracsim.sample import find, scene_id
from fracsim.sample.origin import changes
from fracsim.sample.schema import read_meta
from fracsim.scene.knob import check_names
from fracsim.scene.vocab import Scene
from fracsim.solve.march import SimulationError
from fracsim.solve.setup import Ready, ready
from fracsim.solve.simulator import Simulator

FIRST = "compiling kernels, this takes about a minute the first time"
INTERRUPTED = "interrupted by the user"
FEW = 10
"""Frames that are filmed sooner than another process has started."""
EXPECTED = (KeyboardInterrupt, ValueError, OSError, RuntimeError)
"""Errors that are an outcome of a run."""


def run(scene: Scene, watch: Watcher | None = None, beside: bool = False) -> Outcome:
    """Run a scene and write its sample; a whole sample that is already there is not made again.

    Prints nothing. A bad scene, a full disk, an unstable simulation and Ctrl-C are outcomes, not errors;
    `outcome.sample()` raises for them. With `beside`, frames are filmed and written by a second process where that
    saves time.
    """
    watch, timer, recorder = watch or Watcher(), Stopwatch(), None
    try:
        scene = staged(scene)
        existing = _existing(scene)
        if existing:
            return existing
        check_names(scene)
        if backend.first_use():
            watch.note(FIRST)
        with Beside() if beside and _worthwhile(scene) else Recorder(timer) as recorder:
            backend.start(scene.backend)
            prepared = ready(scene)
            recorder.open(scene)
            return _record(scene, prepared, recorder, timer, watch)
    except EXPECTED as error:
        return _stopped(error, recorder)


def _worthwhile(scene: Scene) -> bool:
    """Whether a second process saves time: there are pictures, and a core that the simulation does not always use."""
    several = backend.threads(scene.backend) > 1 and scene.capture.frames >= FEW
    return os.name == "posix" and scene.backend.arch == "cpu" and several and scene.capture.renders


def _existing(scene: Scene) -> Outcome | None:
    """The outcome of a scene whose sample is there, unless it is to be made again."""
    path = find(scene.output, scene_id(scene))
    if path is None or scene.output.overwrite:
        return None
    meta = read_meta(path)
    return Outcome("existing", path, changes(scene, meta), meta["report"], meta["seconds"], meta["frames"])


def _stopped(error: BaseException, recorder: Recorder | Beside | None) -> Outcome:
    """The outcome of an error, and of the frames that the recorder has kept."""
    frames = recorder.frames if recorder else 0
    path = recorder.folder if recorder and frames else None
    if isinstance(error, KeyboardInterrupt) or interrupted():
        return Outcome("interrupted", path, INTERRUPTED, frames=frames)
    return Outcome("failed", path, str(error), frames=frames)


def _record(scene: Scene, prepared: Ready, recorder: Recorder | Beside, timer: Stopwatch, watch: Watcher) -> Outcome:
    """Prepare the object, record all frames and finish the sample; raises when no frame was written."""
    with timer("prepare"):
        particles = build_of(scene)
    simulator = Simulator(scene, particles, watch.substeps, prepared)
    recorder.begin(simulator.particles)
    reason = _shoot(simulator, recorder, timer, watch)
    report = simulator.report
    seconds = dict(timer.seconds)
    path, summary, frames = recorder.finish(Ending(report.summary(), vars(report.history), seconds, reason))
    if reason == INTERRUPTED:
        return Outcome("interrupted", path, reason, summary, seconds, frames)
    if reason:
        kept = f"{reason} Kept: {frames} of {scene.capture.frames} frames, in {path}."
        return Outcome("failed", path, kept, summary, seconds, frames)
    status, doubts = health(summary)
    return Outcome(status, path, doubts, summary, seconds, frames)


def _shoot(simulator: Simulator, recorder: Recorder | Beside, timer: Stopwatch, watch: Watcher) -> str:
    """Simulate and record all frames; returns why it ended early, or "". Raises when no frame was recorded."""
    try:
        with Interrupt() as interrupt:
            for frame in timer.timed("simulate", simulator.frames()):
                recorder.add(frame)
                watch.frame(frame.index)
                interrupt.check()
    except (SimulationError, KeyboardInterrupt) as error:
        if not recorder.frames:
            raise
        return str(error) or INTERRUPTED
    return ""
