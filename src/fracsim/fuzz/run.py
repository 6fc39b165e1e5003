"""Runs one case of the study."""

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field

from fracsim import backend
from fracsim.fuzz import fitting
from fracsim.fuzz.bodies import build
from fracsim.fuzz.case import Case, sensible
from fracsim.fuzz.invariants import Watch
from fracsim.records import Frame
from fracsim.scene.vocab import Backend, Scene
from fracsim.solve.march import SimulationError
from fracsim.solve.simulator import Simulator

Observer = Callable[[Simulator, Frame, Watch], None]
"""Called after each frame."""


@dataclass(kw_only=True)
class Outcome:
    """The end of a case: one line of the journal."""

    family: str
    seed: int
    number: int
    verdict: str
    """finished, refused (by an error that fits) or wrong."""
    reason: str = ""
    """Kind of the error, or empty."""
    error: str = ""
    wrong: list[str] = field(default_factory=list)
    """Sentences: violated invariants, and why an error does not fit."""
    sensible: bool = False
    """Whether the scene had to run to its end."""
    particles: int = 0
    substeps: int = 0
    parted: bool = False
    seconds: float = 0.0


def run(case: Case, observer: Observer | None = None) -> Outcome:
    """Run a case to its end. An error becomes part of the outcome."""
    start = time.perf_counter()
    out = Outcome(family=case.family, seed=case.seed, number=case.number, verdict="finished")
    try:
        scene = case.resolve()
        out.sensible = sensible(case, scene)
        _simulate(case, scene, out, observer)
    except (ValueError, SimulationError) as error:
        out.reason, out.error = fitting.kind(error), str(error)
        out.verdict = "refused"
        if out.reason.startswith(fitting.UNSTABLE):  # energy grows before such an end; the error reports it already
            out.wrong = [sentence for sentence in out.wrong if not sentence.startswith("energy")]
        out.wrong += fitting.unfit(error, out.sensible)
    except Exception as error:
        out.reason, out.error = type(error).__name__, traceback.format_exc(limit=-2)
        out.wrong.append(f"{type(error).__name__}: {error}")
    if out.wrong:
        out.verdict = "wrong"
    out.seconds = round(time.perf_counter() - start, 3)
    return out


def _simulate(case: Case, scene: Scene, out: Outcome, observer: Observer | None) -> None:
    """Run and check all frames. Fills in counts and violations, also if an error ends the run."""
    backend.start(Backend(threads=1))
    simulator = Simulator(scene, build(case.body, scene.solver))
    case.start.apply(simulator.state)
    watch = Watch(simulator, out.sensible)
    out.particles = len(simulator.particles)
    try:
        for frame in simulator.frames():
            watch.frame(frame)
            if observer:
                observer(simulator, frame, watch)
    finally:
        out.substeps, out.parted = simulator.report.substeps, simulator.report.parted
        out.wrong += watch.violations
