"""Ctrl-C is not lost where Python drops exceptions."""

import os
import signal
import time

import pytest

from fracsim.entry.interrupt import Interrupt, interrupted


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_ctrl_c_is_not_lost_in_a_destructor() -> None:
    class Noisy:
        def __del__(self) -> None:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)

    before = signal.getsignal(signal.SIGINT)
    with Interrupt() as interrupt:
        interrupt.check()
        Noisy()
        with pytest.raises(KeyboardInterrupt):
            interrupt.check()
    assert signal.getsignal(signal.SIGINT) is before


def test_an_error_that_a_signal_caused_within_a_library_is_an_interruption() -> None:
    """Both of nested contexts know of the signal, whose exception a library has replaced by one of its own."""
    assert not interrupted()
    with Interrupt() as outer:
        with Interrupt() as inner:
            try:
                os.kill(os.getpid(), signal.SIGTERM)
                time.sleep(0.01)
            except KeyboardInterrupt:
                pass
            assert inner.seen
        assert interrupted()
        with pytest.raises(KeyboardInterrupt):
            outer.check()
    assert not interrupted()
