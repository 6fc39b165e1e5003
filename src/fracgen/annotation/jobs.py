"""Commands in processes of their own, one at a time; those that wait, and the one that runs, can be cancelled."""

import os
import re
import secrets
import signal
import subprocess
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fracsim.entry import SIGNS

PROGRESS = re.compile(r"\b(?:frame|call) (\d+) of (\d+)")
"""Signs of life of fracsim and fracgen.sample."""
OUTCOME = re.compile(r"break {2,}(\S.*)")
"""The line of a simulation's table that says when the object parted."""
PATIENCE = 5.0
"""Seconds between asking a process to end and ending it."""
WAITING = 8
"""Most jobs that wait."""
LINE, KEPT = 2000, 20
"""Longest line that is read at once, and lines that are kept."""
FILM = "strip.mp4"
"""All pictures of a sample side by side."""


class FullError(Exception):
    """Too many jobs wait."""


@dataclass(eq=False)
class Job:
    """A command that writes a sample below `folder`."""

    owner: str
    """The session that asked for it."""
    kind: str
    picture: int
    """Number of the picture that it is about."""
    command: Sequence[str]
    folder: Path
    id: str = field(default_factory=lambda: secrets.token_hex(8))
    state: str = "waiting"
    """waiting, running, done, failed or cancelled."""
    done: float = 0.0
    """Part that is done."""
    text: str = ""
    """What it says last, or why it failed."""
    film: Path | None = None
    process: "subprocess.Popen[str] | None" = None

    @property
    def active(self) -> bool:
        """Whether it waits or runs."""
        return self.state in ("waiting", "running")


class Queue:
    """Runs jobs in the order in which they came; `close` ends all."""

    def __init__(self) -> None:
        self._jobs: list[Job] = []
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="jobs", daemon=True)
        self._thread.start()

    def add(self, job: Job) -> None:
        """Let a job wait for its turn; raises FullError when too many wait already."""
        with self._changed:
            if sum(other.state == "waiting" for other in self._jobs) >= WAITING:
                raise FullError(f"{WAITING} jobs wait already: cancel one, or wait.")
            self._jobs.append(job)
            self._changed.notify_all()

    def of(self, owner: str) -> list[Job]:
        """The jobs of a session, the oldest first."""
        with self._changed:
            return [job for job in self._jobs if job.owner == owner]

    def before(self, job: Job) -> int:
        """How many jobs come before one that waits."""
        with self._changed:
            return sum(other.active for other in self._jobs[: self._jobs.index(job)])

    def cancel(self, job: Job) -> None:
        """End a job that waits or runs; one that has ended stays as it is."""
        with self._changed:
            if not job.active:
                return
            job.state = "cancelled"
            if job.process is not None:
                _end(job.process)

    def drop(self, owner: str) -> None:
        """Cancel and forget the jobs of a session, once none of its processes runs."""
        for job in self.of(owner):
            self.cancel(job)
        with self._changed:
            self._changed.wait_for(lambda: all(j.process is None for j in self._jobs if j.owner == owner), 2 * PATIENCE)
            self._jobs = [job for job in self._jobs if job.owner != owner]

    def close(self) -> None:
        """Cancel all jobs and wait until the process that runs has ended."""
        with self._changed:
            self._closed = True
            jobs = list(self._jobs)
            self._changed.notify_all()
        for job in jobs:
            self.cancel(job)
        self._thread.join(2 * PATIENCE)

    def _work(self) -> None:
        """The thread that runs jobs."""
        while (job := self._next()) is not None:
            self._run(job)
            with self._changed:
                job.process = None
                self._changed.notify_all()

    def _next(self) -> Job | None:
        """The next job, now running; None when the queue is closed."""
        with self._changed:
            while not self._closed:
                for job in self._jobs:
                    if job.state == "waiting":
                        job.state = "running"
                        return job
                self._changed.wait()
        return None

    def _run(self, job: Job) -> None:
        """Run a job to its end; whatever happens, it has one."""
        try:
            with self._changed:  # between these a cancel would find no process
                if job.state != "running":
                    return
                job.process = process = _start(job)
            code = _follow(job, process)
        except OSError as error:
            code, job.text = -1, f"The command cannot be started: {error}"
        with self._changed:
            if job.state != "running":
                return
            job.film = next(_films(job.folder), None)
            if code == 0 and job.film is None:
                job.text = "The command has ended without a film."
            job.state = "done" if code == 0 and job.film else "failed"
            job.done = 1.0 if job.state == "done" else job.done


def _start(job: Job) -> "subprocess.Popen[str]":
    """The process of a job, in a group of its own, so that what it starts ends with it."""
    return subprocess.Popen(
        list(job.command), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, errors="replace", start_new_session=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1", "COLUMNS": "200", SIGNS: "0.5"},
    )  # fmt: skip


def _follow(job: Job, process: "subprocess.Popen[str]") -> int:
    """Note what a process says until it ends; its exit status."""
    output = process.stdout
    assert output is not None
    last: deque[str] = deque(maxlen=KEPT)
    for line in iter(lambda: output.readline(LINE), ""):
        if not line.strip():
            continue
        last.append(line.strip())
        found = PROGRESS.search(line)
        if found or not job.done:  # what comes after the frames is a table
            job.text = last[-1]
        if found:
            job.done = min(1.0, int(found[1]) / max(1, int(found[2])))
    code = process.wait()
    job.text = _told(last, code)
    return code


def _told(last: Sequence[str], code: int) -> str:
    """What a process that has ended said that matters: the break of the object, its error, or its last line."""
    if not code:
        return next((found[1] for line in last if (found := OUTCOME.match(line))), "")
    if code < 0:
        return f"The process was ended by signal {-code}."
    errors = [line for line in last if line.startswith("error:")]
    return (errors or list(last) or [f"The process ended with status {code} and no word."])[-1].removeprefix("error: ")


def _end(process: "subprocess.Popen[str]") -> None:
    """Ask a process and what it has started to end, and end them when they do not."""
    _signal(process, signal.SIGTERM)
    later = threading.Timer(PATIENCE, _signal, (process, getattr(signal, "SIGKILL", signal.SIGTERM)))
    later.daemon = True
    later.start()


def _signal(process: "subprocess.Popen[str]", number: int) -> None:
    """Send a signal to the group of a process that still runs."""
    if process.poll() is not None:
        return
    try:
        os.killpg(process.pid, number)
    except AttributeError:  # Windows has no groups of this kind
        process.terminate()
    except ProcessLookupError:
        pass


def _films(folder: Path) -> Iterator[Path]:
    """The films of finished samples below a folder, the newest first."""
    found = [path for path in folder.glob(f"*/{FILM}") if path.parent.suffix != ".incomplete"]
    yield from sorted(found, key=lambda path: path.stat().st_mtime, reverse=True)


def told(job: Job, queue: Queue) -> dict[str, Any]:
    """What a page shows of a job."""
    waiting = queue.before(job) if job.state == "waiting" else 0
    return {"id": job.id, "kind": job.kind, "state": job.state, "done": job.done, "text": job.text, "before": waiting}
