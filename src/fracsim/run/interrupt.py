"""Ctrl-C that is never lost."""

import signal
import threading
from types import FrameType, TracebackType


class Interrupt:
    """A context in which `check` raises KeyboardInterrupt after a Ctrl-C.

    Ctrl-C also raises at once, but Python drops errors of destructors and of callbacks from C: the run would go on.
    """

    def __init__(self) -> None:
        self.seen = False

    def __enter__(self) -> "Interrupt":
        self._ours = threading.current_thread() is threading.main_thread()  # the only one that may set handlers
        if self._ours:
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._ours:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.seen = True
        raise KeyboardInterrupt

    def check(self) -> None:
        """Raise KeyboardInterrupt if there was a Ctrl-C."""
        if self.seen:
            raise KeyboardInterrupt
