"""Many scenes one after the other in one process: nothing is lost, and a failure never stops the others."""

import hashlib
import time
import traceback
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from fracsim.entry.interrupt import Interrupt, interrupted
from fracsim.run import journal
from fracsim.run.attempt import Attempt, Summary, Task
from fracsim.run.outcome import Outcome, Status
from fracsim.run.watcher import SweepWatcher, Watcher
from fracsim.sample import scene_id
from fracsim.sample.folder import clear, root
from fracsim.scene.knob import text
from fracsim.scene.vocab import Output, Scene

_cleared: set[Path] = set()
"""Folders whose leftovers this process has removed."""


def run_all(
    scenes: Iterable[Scene | Task], watch: SweepWatcher | None = None, record: bool = True, beside: bool = False
) -> Summary:
    """Run scenes, write their samples, and count what came of them; prints nothing.

    Whole samples that are there are not made again. With `record`, every other attempt is a line of the journal, and a
    failed one a file in failures/. After Ctrl-C, SIGTERM or SIGHUP the scene is kept as incomplete, and no other one
    begins. `beside` is that of `pipeline.run`. Raises OSError when the journal cannot be written.
    """
    watch, summary = watch or SweepWatcher(), Summary()
    with Interrupt() as interrupt:
        for item in scenes:
            interrupt.check()
            task = item if isinstance(item, Task) else Task(item)
            with watch.scene(task) as follow:
                attempt = run_one(task, follow, record, beside)
            summary.add(attempt)
            watch.done(attempt)
            if summary.interrupted:
                break
        else:
            interrupt.check()
    return summary


def run_one(task: Task, follow: Watcher | None = None, record: bool = True, beside: bool = False) -> Attempt:
    """Run one scene as `run_all` does; after an interruption the attempt says so."""
    folder = _folder(task)
    if folder not in _cleared:
        clear(folder)
        _cleared.add(folder)
    start, details = time.perf_counter(), ""
    try:
        outcome = _run(task, follow, beside)
    except Exception as error:  # a fault of the program: of this scene, not of the sweep
        status: Status = "interrupted" if interrupted() else "failed"
        outcome = Outcome(status, reason=f"{type(error).__name__}: {error}")
        details = traceback.format_exc()
    attempt = Attempt(task, _name(task), outcome, time.perf_counter() - start)
    if not record:
        return attempt
    if outcome.status == "failed":
        attempt = replace(attempt, failure=str(journal.write_failure(folder, attempt, details)))
    elif outcome.finished:
        journal.failure_file(folder, attempt.name).unlink(missing_ok=True)  # of an earlier attempt
    journal.write(folder, attempt)
    return attempt


def _run(task: Task, follow: Watcher | None, beside: bool) -> Outcome:
    """What comes of a task."""
    if task.scene is None:
        return Outcome("failed", reason=task.error)
    from fracsim.run import pipeline  # loads Taichi, which a process that only starts others does not need

    return pipeline.run(task.scene, follow, beside)


def _folder(task: Task) -> Path:
    """The folder of samples that a task writes to."""
    if task.scene is not None:
        return root(task.scene.output)
    given = task.content.get("output")
    return root(Output(folder=str(given["folder"]) if isinstance(given, dict) and "folder" in given else "outputs"))


def _name(task: Task) -> str:
    """The id of the sample, or a hash of what was asked for when there is none."""
    try:
        if task.scene is not None:
            return scene_id(task.scene)
    except ValueError:  # the file of its object cannot be read
        pass
    asked = text(dict(task.content)) + " ".join(task.overrides)
    return hashlib.sha256(asked.encode()).hexdigest()[:12]
