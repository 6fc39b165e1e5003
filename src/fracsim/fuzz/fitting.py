"""Whether an error fits the scene that it ends.

All scenes of the study are within the ranges of the single fields, so an error about a range ("is not allowed") never
fits. The other errors fit these scenes:

- *empty grip*, *gauge*, *large grid*: all. They are about combinations of fields (a grip beside the object, grips that
  touch, a body spread over too many cells).
- *thresholds* (crit not above onset), *substep* (a fixed dt above the bound, without override), *damping* (a viscosity
  per substep that no substep bears): all. Only such scenes can raise them.
- *blow-up* (a particle faster than solver.max_speed or not finite, too many crushed particles, a stability bound that
  is not a number), *flown off* (a particle left the grid), *slow* (a stability bound so low that the run would hardly
  end): scenes that are not `sensible`. These have a fixed dt (the bound at rest does not hold for a stretched state),
  an initial state other than rest, grips faster than the waves, or a weight that crushes them. A sensible scene must
  run to its end.

An error must also name a field, and end with a way out.
"""

import re
from dataclasses import dataclass

from fracsim.scene.knob import describe
from fracsim.scene.vocab import Scene

UNSTABLE = ("blow-up", "flown off")
"""Prefixes of the kinds of error that end an unstable motion. Its energy has grown by then."""
FIELDS = re.compile("|".join(re.escape(name) for name, _, _ in describe(Scene)) + r"|field [xvFd]\b")
WAY_OUT = re.compile(r"\b([Uu]se|[Cc]hoose|[Ss]et|[Rr]aise)\b")


@dataclass(frozen=True)
class Kind:
    """One kind of error, recognised by a pattern in its message."""

    name: str
    pattern: str
    anywhere: bool
    """Whether it fits `sensible` scenes too."""


KINDS = (
    Kind("empty grip", r"grip holds no particle", True),
    Kind("gauge", r"leaves no material between grips", True),
    Kind("large grid", r"^the grid would need", True),
    Kind("thresholds", r"fracture\.crit=.* must be greater than fracture\.onset", True),
    Kind("substep", r"solver\.dt=.* exceeds the stability bound", True),
    Kind("damping", r"solver\.damping=per_substep is unstable", True),
    Kind("blow-up: speed", r"exceeds solver\.max_speed", False),
    Kind("blow-up: not finite", r"v is not finite|bound of solver\.dt=auto is not a number", False),
    Kind("blow-up: crushed", r"inverted or crushed", False),
    Kind("slow", r"times the substeps that all of it takes at rest", False),
    Kind("flown off", r"left the grid|has flown off", False),
)


def kind(error: Exception) -> str:
    """The name of an error's kind, or of its Python type if no kind matches."""
    for k in KINDS:
        if re.search(k.pattern, str(error)):
            return k.name
    return type(error).__name__


def unfit(error: Exception, sensible: bool) -> list[str]:
    """Sentences on why an error does not fit the end of a scene; empty if it fits."""
    known = {k.name: k for k in KINDS}
    name, faults = kind(error), []
    if name not in known:
        return [f"no fitting error: {type(error).__name__}: {error}"]
    if sensible and not known[name].anywhere:
        faults.append(f"{name} in a sensible scene: {error}")
    if not FIELDS.search(str(error)):
        faults.append(f"the error names no field: {error}")
    if not WAY_OUT.search(str(error)):
        faults.append(f"the error names no way out: {error}")
    return faults
