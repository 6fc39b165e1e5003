"""What follows a run, or many, while they go on."""

from collections.abc import Iterator
from contextlib import contextmanager

from fracsim.run.attempt import Attempt, Task


class Watcher:
    """Is called by a run; does nothing itself, and subclasses override what they need."""

    def note(self, text: str) -> None:
        """Called with a sentence for the user, before the first substep."""

    def substeps(self, done: int, dt: float, t: float) -> None:
        """Called every few substeps: their number so far, the present substep dt [s] and time t [s]."""

    def frame(self, index: int) -> None:
        """Called after frame `index` has been written."""


class SweepWatcher:
    """Is called by a sweep; does nothing itself, and subclasses override what they need."""

    @contextmanager
    def scene(self, task: Task) -> Iterator[Watcher]:
        """Entered around each attempt; yields what follows its run."""
        yield Watcher()

    def done(self, attempt: Attempt) -> None:
        """Called after each attempt, once it is in the journal."""
