"""What follows a run while it goes on."""


class Watcher:
    """Is called by a run; does nothing itself, and subclasses override what they need."""

    def substeps(self, done: int, dt: float, t: float) -> None:
        """Called every few substeps: their number so far, the present substep dt [s] and time t [s]."""

    def frame(self, index: int) -> None:
        """Called after frame `index` has been written."""
