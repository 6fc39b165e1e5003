"""Runs the commands of a step as processes of their own, two at a time, and keeps what was finished."""

import glob
import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fracgen.laptop.steps import Command, Step
from fracsim.entry import complain

CORES = 2
"""Commands that run at the same time, with one thread each."""
EVERY = 60.0
"""Seconds between two lines that say how far a step is."""
POLL = 0.5
"""Seconds between two looks at the processes."""
SHOWN = 14
"""Last lines of the output of a command that are shown when it has ended."""


class FailedError(Exception):
    """A command failed; the text says which, and where its messages lie."""


def resolved(command: Command) -> Command:
    """A command whose patterns are replaced by what they fit; raises FailedError for one that fits nothing."""
    return tuple(_resolved(argument) for argument in command)


def _resolved(argument: str) -> str:
    name, sign, pattern = argument.partition("=")
    if not (sign and pattern.endswith("-*")):
        return argument
    found = [path for path in glob.glob(pattern) if (Path(path) / "run.json").is_file()]
    if not found:
        raise FailedError(f"{pattern} is no finished training: run the steps before this one.")
    return f"{name}={max(found, key=os.path.getmtime)}"


def typed(command: Command) -> str:
    """A command as one types it; a pattern becomes a call of ls, which knows the name that a training got."""
    words = []
    for argument in command:
        name, sign, pattern = argument.partition("=")
        words.append(f'{name}="$(ls -td {pattern} | head -n 1)"' if sign and pattern.endswith("-*")
                     else shlex.quote(argument))  # fmt: skip
    return f"python -m {' '.join(words)}"


def outputs(step: Step) -> set[Path]:
    """The folders that the commands of a step write to."""
    words = [argument.partition("=") for command in step.commands for argument in command]
    return {Path(value) for name, _, value in words if name == "output.folder"}


@dataclass
class Journal:
    """What was finished: a file a step, with its commands and how long they took."""

    folder: Path

    def read(self, step: Step) -> Mapping[str, Any] | None:
        """The entry of a step, if these very commands were finished and what they wrote is there."""
        try:
            entry = json.loads(self._file(step).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        same = entry["commands"] == [list(command) for command in step.commands]
        return entry if same and all(folder.is_dir() for folder in outputs(step)) else None

    def write(self, step: Step, seconds: float, failed: int) -> None:
        """Mark a step as finished; `failed` of its commands did not do all that was asked."""
        self.folder.mkdir(parents=True, exist_ok=True)
        entry = {"step": step.name, "commands": step.commands, "seconds": round(seconds, 1), "failed": failed}
        part = self._file(step).with_suffix(".part")
        part.write_text(json.dumps(entry, indent=1) + "\n", encoding="utf-8")
        os.replace(part, self._file(step))

    def _file(self, step: Step) -> Path:
        return self.folder / f"{step.name}.json"


@dataclass
class Runner:
    """Runs commands; `start` is replaced in tests."""

    logs: Path
    start: Callable[..., Any] = subprocess.Popen
    running: list[Any] = field(default_factory=list)

    def run(self, step: Step) -> int:
        """Run a step; the number of commands that failed, where what they made is enough.

        Raises FailedError when a command failed, KeyboardInterrupt after the processes have been told to end.
        """
        commands = [resolved(command) for command in step.commands]
        self.logs.mkdir(parents=True, exist_ok=True)
        failed = 0
        try:
            for code, log in self._each(step, commands):
                if code and step.enough is None:
                    raise FailedError(f"{step.name}: a command ended with {code}; its last words: {_tail(log, 3)} "
                                      f"(all of them: {log}). Repeat the command to go on.")  # fmt: skip
                failed += bool(code)
        finally:
            self._end()
        lack = step.enough() if step.enough else ""
        if lack:
            raise FailedError(f"{step.name}: {lack}; see {self.logs}/{step.name}-*.log")
        return failed

    def _each(self, step: Step, commands: Sequence[Command]) -> Iterator[tuple[int, Path]]:
        """The exit status and the log of each command, as it ends."""
        waiting, logs = list(enumerate(commands)), {}
        most, begin, told = (CORES if step.together else 1), time.monotonic(), time.monotonic()
        while waiting or self.running:
            while waiting and len(self.running) < most:
                number, command = waiting.pop(0)
                log = self.logs / f"{step.name}-{number}.log"
                say(f"  {typed(command)}")
                process = self._start(command, log, CORES // min(most, len(commands)))
                self.running.append(process)
                logs[id(process)] = log
            time.sleep(POLL)
            for process in [one for one in self.running if one.poll() is not None]:
                self.running.remove(process)
                log = logs.pop(id(process))
                say(_indented(_tail(log, SHOWN)))
                yield process.returncode, log
            if time.monotonic() - told > EVERY:
                told = time.monotonic()
                done = len(commands) - len(waiting) - len(self.running)
                latest = "; ".join(_tail(logs[id(one)], 1) for one in self.running)
                say(f"  {(told - begin) / 60:.0f} min, {done} of {len(commands)} done; {latest}")

    def _start(self, command: Command, log: Path, threads: int) -> Any:
        """A process that writes to a log."""
        environment = {**os.environ, "OMP_NUM_THREADS": str(threads), "PYTHONUNBUFFERED": "1", "COLUMNS": "120"}
        with log.open("w") as out:
            # In a session of its own, a Ctrl-C reaches it once, by `_end`.
            return self.start([sys.executable, "-m", *command], stdout=out, stderr=subprocess.STDOUT, env=environment,
                              start_new_session=True)  # fmt: skip

    def _end(self) -> None:
        """Tell the processes that still run to end, and wait for them: they leave what can be gone on with."""
        for process in self.running:
            process.terminate()
        for process in self.running:
            process.wait()
        self.running.clear()


def _tail(log: Path, lines: int) -> str:
    """The last lines of a log."""
    try:
        text = log.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    return "\n".join([line for line in text.splitlines() if line.strip()][-lines:])


def _indented(text: str) -> str:
    return "\n".join(f"    {line}" for line in text.splitlines())


def say(text: str) -> None:
    """Print at once."""
    if text:
        print(text, flush=True)


def all_steps(steps: Sequence[Step], journal: Journal, runner: Runner, again: bool = False) -> bool:
    """Run what is not finished, or `again`; whether all is. A failure is explained, and nothing after it is run."""
    whole = sum(step.minutes for step in steps)
    left = whole
    for number, step in enumerate(steps, 1):
        heading = f"[{number} of {len(steps)}] {step.name}: {step.about}"
        if (entry := journal.read(step)) is not None and not again:
            say(f"{heading}: finished before, in {entry['seconds'] / 60:.1f} min")
        else:
            say(f"{heading}; about {step.minutes:g} min of {left:.0f} that are left")
            begin = time.monotonic()
            try:
                failed = runner.run(step)
            except FailedError as error:
                complain(str(error))
                return False
            journal.write(step, time.monotonic() - begin, failed)
        left -= step.minutes
    return True
