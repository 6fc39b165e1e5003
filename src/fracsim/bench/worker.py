"""Processes that measure on request."""

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any

Answer = dict[str, Any]


class Worker:
    """A process `python -m fracsim.bench.<part> ...`: it prepares itself, then answers each `go` by a line of JSON.

    A context manager. Raises RuntimeError if the process ends early.
    """

    def __init__(self, part: str, *arguments: object, env: Mapping[str, str] | None = None) -> None:
        command = [sys.executable, "-m", f"fracsim.bench.{part}", *map(str, arguments)]
        self._what = " ".join(command[2:])
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=env)
        self.ready = self.answer()

    def go(self) -> None:
        """Start one measurement."""
        assert self._process.stdin is not None
        self._process.stdin.write("go\n")
        self._process.stdin.flush()

    def answer(self) -> Answer:
        """Wait for the next answer; other lines, such as Taichi's greeting, are skipped."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith("{"):
                answer: Answer = json.loads(line)
                return answer
        raise RuntimeError(f"{self._what} ended with status {self._process.wait()}: see its error above.")

    def measure(self) -> Answer:
        """Make one measurement."""
        self.go()
        return self.answer()

    def __enter__(self) -> "Worker":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def serve(measure: Callable[[], Answer], **about: Any) -> None:
    """The worker's side: print `about` once prepared, then measure at each `go` until the input ends."""
    print(json.dumps(about), flush=True)
    for _ in sys.stdin:
        print(json.dumps(measure()), flush=True)
