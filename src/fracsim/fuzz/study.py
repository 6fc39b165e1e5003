"""Runs the scenes of a study in a worker process, so that a crash or a hang of one does not end the study."""

import importlib.util
import json
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from fracsim.fuzz.case import Case, write
from fracsim.fuzz.draw import CYCLE, draw
from fracsim.fuzz.run import Outcome, run

LIMIT = 120.0
"""Seconds after which a scene counts as hung, compilation of kernels included."""
MEMORY = 8 * 2**30
"""Bytes of address space of a worker. A scene that needs more fails, and the machine does not run out of memory."""
JOURNAL = "results.jsonl"
Task = Callable[[Case], Outcome]
resource: Any = importlib.import_module("resource") if importlib.util.find_spec("resource") else None


class Worker:
    """A process that runs cases, replaced by a new one after a crash or a hang."""

    def __init__(self, task: Task = run, limit: float = LIMIT) -> None:
        self._task, self._limit = task, limit
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None

    def __call__(self, case: Case) -> Outcome:
        """The outcome of a case."""
        process, pipe = self._running()
        pipe.send(case)
        try:
            if pipe.poll(self._limit):
                out: Outcome
                out, stays = pipe.recv()
                if not stays:
                    self.stop()
                return out
            reason, sentence = "hung", f"hung: no end within {self._limit:g} s"
        except (EOFError, OSError):
            process.join()
            reason, sentence = "crashed", f"crashed: the process ended with status {process.exitcode}"
        self.stop()
        return Outcome(family=case.family, seed=case.seed, number=case.number, verdict="wrong", reason=reason,
                       wrong=[sentence], seconds=self._limit if reason == "hung" else 0.0)  # fmt: skip

    def _running(self) -> tuple[BaseProcess, Connection]:
        """The running process, started if necessary, and the pipe to it."""
        if self._process is None or self._pipe is None:
            context = multiprocessing.get_context("spawn")
            self._pipe, remote = context.Pipe()
            self._process = context.Process(target=_serve, args=(remote, self._task), daemon=True)
            self._process.start()
            remote.close()
        return self._process, self._pipe

    def stop(self) -> None:
        """Kill the process, if there is one."""
        if self._process is not None and self._pipe is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
        self._process = self._pipe = None


def _serve(pipe: Connection, task: Task) -> None:
    """The worker process: run each case that arrives and send its outcome, and whether memory is left for another.

    Taichi does not give memory back. Ctrl-C is ignored here, the parent handles it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _limit_memory()
    while True:
        try:
            case = pipe.recv()
        except EOFError:
            return
        out = task(case)
        pipe.send((out, _used() < MEMORY / 4))


def _used() -> int:
    """Peak memory of this process [bytes]."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss if resource else 0


def _limit_memory() -> None:
    """Limit the address space of this process to MEMORY, if the system can."""
    if resource is None:
        return
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY if most < 0 else min(MEMORY, most), most))


def numbers(scenes: int, only: Sequence[str]) -> list[int]:
    """The numbers below `scenes` of the families `only`, of all families if it is empty."""
    return [k for k in range(scenes) if not only or CYCLE[k % len(CYCLE)] in only]


def journal(folder: Path, seed: int) -> dict[int, Outcome]:
    """The outcomes by number in the journal of a folder, of the study with this seed; other lines are skipped."""
    path, known = folder / JOURNAL, {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            out = Outcome(**json.loads(line))
        except (TypeError, ValueError):  # cut short, or written by another version
            continue
        if out.seed == seed:
            known[out.number] = out
    return known


def study(folder: Path, seed: int, wanted: Sequence[int], worker: Worker) -> Iterator[Outcome]:
    """Run the cases `wanted` that are not in the journal of the folder; yields each outcome after writing it there.

    Wrong cases are kept as YAML files in `folder`/wrong.
    """
    known = journal(folder, seed)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with (folder / JOURNAL).open("a", encoding="utf-8") as file:
            if file.tell() and not (folder / JOURNAL).read_text(encoding="utf-8").endswith("\n"):
                file.write("\n")
            for number in wanted:
                if number in known:
                    continue
                case = draw(seed, number)
                out = worker(case)
                if out.verdict == "wrong":
                    write(case, folder / "wrong" / f"{case.name}.yaml", "\n".join(out.wrong))
                file.write(json.dumps(asdict(out)) + "\n")
                file.flush()
                yield out
    finally:
        worker.stop()
