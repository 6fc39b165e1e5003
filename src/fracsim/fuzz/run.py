"""One scene of the study from its data to its outcome."""

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

Onlooker = Callable[[Simulator, Frame, Watch], None]
"""Called after each frame."""


@dataclass(kw_only=True)
class Outcome:
    """How a scene ended: one line of the journal."""

    family: str
    seed: int
    number: int
    verdict: str
    """finished, refused (with the error that fits) or wrong."""
    reason: str = ""
    """Kind of the error, if there was one."""
    error: str = ""
    wrong: list[str] = field(default_factory=list)
    """What was violated, sentences."""
    sensible: bool = False
    """Whether the scene had to run to its end."""
    particles: int = 0
    substeps: int = 0
    parted: bool = False
    seconds: float = 0.0


def run(case: Case, onlooker: Onlooker | None = None) -> Outcome:
    """Run a case to its end; whatever is raised is part of the outcome."""
    begun = time.perf_counter()
    out = Outcome(family=case.family, seed=case.seed, number=case.number, verdict="finished")
    try:
        scene = case.resolve()
        out.sensible = sensible(case, scene)
        _simulate(case, scene, out, onlooker)
    except (ValueError, SimulationError) as error:
        out.reason, out.error = fitting.kind(error), str(error)
        out.verdict = "refused"
        if out.reason.startswith(fitting.UNSTABLE):  # on its way there energy grows, and the error says so
            out.wrong = [told for told in out.wrong if not told.startswith("energy")]
        out.wrong += fitting.unfit(error, out.sensible)
    except Exception as error:
        out.reason, out.error = type(error).__name__, traceback.format_exc(limit=-2)
        out.wrong.append(f"{type(error).__name__}: {error}")
    if out.wrong:
        out.verdict = "wrong"
    out.seconds = round(time.perf_counter() - begun, 3)
    return out


def _simulate(case: Case, scene: Scene, out: Outcome, onlooker: Onlooker | None) -> None:
    """All frames, watched; fills in what was counted, also when it ends by an error."""
    backend.start(Backend(threads=1))
    simulator = Simulator(scene, build(case.body, scene.solver))
    case.start.apply(simulator.state)
    watch = Watch(simulator, out.sensible)
    out.particles = len(simulator.particles)
    try:
        for frame in simulator.frames():
            watch.frame(frame)
            if onlooker:
                onlooker(simulator, frame, watch)
    finally:
        out.substeps, out.parted = simulator.report.substeps, simulator.report.parted
        out.wrong += watch.violations
