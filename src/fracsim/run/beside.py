"""A recorder in a process of its own, so that frames are filmed and written while the next ones are simulated.

Threads of one process would take turns: a kernel of Taichi holds Python's lock while it runs.
"""

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import warnings
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, NamedTuple, cast

from fracsim import backend
from fracsim.entry.command import warn_plainly
from fracsim.entry.interrupt import APART
from fracsim.entry.memory import collect_rarely
from fracsim.records import Frame, Particles
from fracsim.run.recorder import Ending, Recorded, Recorder
from fracsim.run.stopwatch import Stopwatch
from fracsim.scene.vocab import Scene

WAITING = 2
"""Frames that may wait for the other process; then the simulation waits."""
NICE = 10
"""How far the other process stands back where both want a core: a substep lasts as long as its slowest thread."""
COMMAND = [sys.executable, "-c", "from fracsim.run.beside import serve; serve()"]
KILLED = (
    "the process that films and writes the frames ended with status {}, as after `kill` or where memory is short: free "
    "some, or set backend.threads=1, with which one process does all."
)


class Answer(NamedTuple):
    """What the other process says: once when it is ready, and once at its end."""

    recorded: Recorded | None = None
    error: Exception | None = None
    frames: int = 0
    """Frames written, at an error."""
    folder: Path | None = None
    """Where they lie."""


class Beside:
    """A `Recorder` in another process; what goes wrong there is raised here by a later call, at last by `finish`."""

    def __init__(self) -> None:
        self.frames = 0
        """Frames that were handed over; after an error there, those that were written."""
        self.folder: Path | None = None
        self._process = subprocess.Popen(COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, **APART)
        self._queue: queue.Queue[bytes | None] = queue.Queue(WAITING)
        self._sender = threading.Thread(target=self._send, daemon=True)
        self._sender.start()
        self._opened = self._ended = self._deaf = False

    def open(self, scene: Scene) -> None:
        """Begin the sample of a scene; for what cannot be used, `begin` raises."""
        self._put(scene)
        self._opened = True

    def begin(self, particles: Particles) -> None:
        """Name the object whose frames will come; raises what `Recorder.open` raises."""
        self._receive()
        self._put(particles)

    def add(self, frame: Frame) -> None:
        """Hand over the next frame; waits while WAITING others have not been taken."""
        self._put(frame)
        self.frames += 1

    def finish(self, end: Ending) -> Recorded:
        """Close the sample once all frames are written, as `Recorder.finish` does."""
        self._put(end)
        recorded = self._receive().recorded
        assert recorded is not None
        return recorded

    def _put(self, message: Any) -> None:
        """Send a message; raises what has ended the other process."""
        if self._deaf:
            self._receive()
        # As one piece: for each the sender needs Python's lock, which kernels hold for tenths of a second.
        self._queue.put(pickle.dumps(message, pickle.HIGHEST_PROTOCOL))

    def _send(self) -> None:
        """Write messages to the pipe until None comes; those for a process that has ended are dropped."""
        pipe = cast(BinaryIO, self._process.stdin)
        for message in iter(self._queue.get, None):
            try:
                pipe.write(message)
                pipe.flush()
            except OSError:
                self._deaf = True
        with suppress(OSError):
            pipe.close()

    def _receive(self) -> Answer:
        """The next answer; raises the error that it holds, and RuntimeError for a process that was killed."""
        try:
            answer: Answer = pickle.load(cast(BinaryIO, self._process.stdout))
        except (EOFError, pickle.UnpicklingError):
            answer = Answer(error=RuntimeError(KILLED.format(self._process.wait())))
        self._ended = answer.error is not None or answer.recorded is not None
        if answer.error is not None:
            self.frames, self.folder = answer.frames, answer.folder
            raise answer.error
        return answer

    def __enter__(self) -> "Beside":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the other process; without `finish` it keeps its frames as incomplete, as `Recorder` does."""
        if not self._opened:
            self._process.kill()
        self._queue.put(None)
        with suppress(Exception):  # what the context is left by counts
            while self._opened and not self._ended:
                self._receive()
        self._sender.join()
        self._process.wait()
        cast(BinaryIO, self._process.stdout).close()


class AbandonedError(Exception):
    """The frames have ended before the last one, without `finish`."""


def serve() -> None:
    """Be the other process: messages come by standard input, answers leave by standard output."""
    messages, answers = sys.stdin.buffer, _answers()
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # the end of the messages is the end
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(NICE)
    collect_rarely()
    warn_plainly()
    with Recorder(Stopwatch()) as recorder:
        try:
            answer = _record(recorder, messages, answers)
        except Exception as error:
            recorder.__exit__(type(error), error, None)
            answer = Answer(None, error, recorder.frames, recorder.folder)
    backend.stop()  # the next process finds the kernels of this one
    _say(answer, answers)


def _record(recorder: Recorder, messages: BinaryIO, answers: BinaryIO) -> Answer:
    """Record a scene, whose frames come until an `Ending`."""
    try:
        scene: Scene = pickle.load(messages)
        threads = max(backend.threads(scene.backend) // 2, 1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the simulation has started Taichi, too, and said it
            backend.start(replace(scene.backend, threads=threads), alone=False)
        recorder.open(scene)
        _say(Answer(), answers)
        if scene.capture.report or scene.capture.strip:  # no frame comes before the kernels of substeps are there
            import fracsim.sample.curves  # noqa: F401  # loads matplotlib
        recorder.begin(pickle.load(messages))
        while isinstance(message := pickle.load(messages), Frame):
            recorder.add(message)
    except (EOFError, pickle.UnpicklingError):
        raise AbandonedError("its simulation was killed, or failed without a word") from None
    return Answer(recorder.finish(message))


def _say(answer: Answer, answers: BinaryIO) -> None:
    """Send an answer, if there still is somebody."""
    with suppress(BrokenPipeError):
        pickle.dump(answer, answers)
        answers.flush()


def _answers() -> BinaryIO:
    """Standard output, for answers only: whatever else is printed goes to standard error."""
    own = os.dup(1)
    os.dup2(2, 1)
    return os.fdopen(own, "wb")
