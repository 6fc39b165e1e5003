"""Ctrl-C that is never lost, and signals that do the same."""

import signal
import sys
import threading
from types import FrameType, TracebackType
from typing import Any

APART: dict[str, Any] = {"process_group": 0} if sys.version_info >= (3, 11) else {"start_new_session": True}
"""Options of `subprocess.Popen` for a process that a Ctrl-C at the terminal must not end.

A group of its own is enough. Linux shares its cores out between sessions first (autogroups): in a session of its own
an encoder would get as much time as the simulation, whatever its niceness.
"""

_active: list["Interrupt"] = []
"""Contexts that are open, the outermost first."""


def interrupted() -> bool:
    """Whether a signal to stop came within an open context.

    Libraries may turn the KeyboardInterrupt into an error of their own, which is then no fault of the input.
    """
    return any(context.seen for context in _active)


class Interrupt:
    """A context in which `check` raises KeyboardInterrupt after a Ctrl-C, SIGTERM (a batch system) or SIGHUP.

    They also raise at once, but Python drops errors of destructors and of callbacks from C: the run would go on. A
    SIGHUP that is ignored, as under nohup, stays ignored.
    """

    def __init__(self) -> None:
        self.seen = False

    def __enter__(self) -> "Interrupt":
        self._ours = threading.current_thread() is threading.main_thread()  # the only one that may set handlers
        _active.append(self)
        self._before = {number: signal.signal(number, self._note) for number in self._signals()}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        _active.remove(self)

    def _signals(self) -> list[signal.Signals]:
        """The signals that stop a run."""
        hangup: signal.Signals | None = getattr(signal, "SIGHUP", None)  # Windows has none
        found = [signal.SIGINT, signal.SIGTERM]
        if hangup and signal.getsignal(hangup) is not signal.SIG_IGN:
            found.append(hangup)
        return found if self._ours else []

    def _note(self, number: int, frame: FrameType | None) -> None:
        for context in _active:
            context.seen = True
        raise KeyboardInterrupt

    def check(self) -> None:
        """Raise KeyboardInterrupt if there was a signal to stop."""
        if self.seen:
            raise KeyboardInterrupt
