"""Signs of life where there is no terminal: a line every ten seconds on stderr, as `frame 12 of 100, 30 s left`."""

import sys
import time

from fracsim.entry import signs_every
from fracsim.run.watcher import Watcher


class Signs(Watcher):
    """Prints how far a run is and how long the rest will take."""

    def __init__(self, frames: int, fps: float) -> None:
        self._frames, self._fps = frames, fps
        self._since, self._every = time.monotonic(), signs_every()
        self._first: tuple[float, float] | None = None

    def note(self, text: str) -> None:
        """Print it."""
        print(text, file=sys.stderr, flush=True)

    def substeps(self, done: int, dt: float, t: float) -> None:
        """Print a line when it is time for one; what came before the first substep does not count for the rest."""
        now, at = time.monotonic(), t * self._fps
        if self._first is None:
            self._first = now, at
        if now - self._since < self._every or at >= self._frames - 1:
            return
        self._since, (began, start) = now, self._first
        left = f", {duration((now - began) * (self._frames - 1 - at) / (at - start))} left" if at > start else ""
        self.note(f"frame {1 + int(at)} of {self._frames}{left}")


def duration(seconds: float) -> str:
    """A time for people, as `1 min`."""
    for unit, size in (("days", 86400), ("h", 3600), ("min", 60)):
        if seconds >= (2 if unit == "days" else 1) * size:
            return f"{seconds / size:.3g} {unit}" if unit != "min" else f"{round(seconds / size)} min"
    return f"{seconds:.0f} s"
