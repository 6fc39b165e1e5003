"""Run the failed and the broken draws of a data set again.

    python -m fracsim.dataset retry DIR

The scenes are those of failures/*.yaml and of samples that are not as they were written. What succeeds takes the place
of the broken sample, and its file in failures/ is deleted; what fails again stays. Exit status 1 when something does.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from fracsim.dataset import folders, index, verify
from fracsim.dataset.command import command
from fracsim.dataset.progress import Progress, shown, silent
from fracsim.run import journal, sweep
from fracsim.run.attempt import Attempt, Task
from fracsim.run.watcher import SweepWatcher
from fracsim.sample import schema
from fracsim.sample.identity import scene_id


class Attempts(SweepWatcher):
    """Keeps the attempts of a sweep."""

    def __init__(self) -> None:
        self.all: list[Attempt] = []

    def done(self, attempt: Attempt) -> None:
        """Keep an attempt."""
        self.all.append(attempt)


def retry(folder: Path | str, progress: Progress = silent) -> tuple[int, list[str]]:
    """Run failed and broken draws again; returns how many succeeded, and the name and reason of each other one.

    Raises ValueError for a folder without samples, KeyboardInterrupt after Ctrl-C.
    """
    root = folders.root(folder)
    broken = [found.name for found in verify.check(root, progress=progress) if found.kind == "broken"]
    files = [*verify.failures(root), *(root / name / schema.SCENE for name in broken)]
    tasks, left = _tasks(root, files)
    watch = Attempts()
    summary = sweep.run_all(progress(tasks.values(), len(tasks), "running scenes"), watch)
    done = _cleared(dict(zip(tasks, watch.all, strict=False)))  # fewer after Ctrl-C
    left += [f"{a.name}: {a.outcome.reason}" for a in watch.all if not a.outcome.finished]
    if done:
        index.build(root)
    if summary.interrupted:
        raise KeyboardInterrupt
    return done, left


def _tasks(root: Path, files: list[Path]) -> tuple[dict[Path, Task], list[str]]:
    """The scene of each file, to be written to `root`; and why the others cannot be run."""
    tasks, left, tried = {}, [], verify.attempts(root)
    for path in files:
        try:
            scene = schema.load_scene(path)
            of_sample = path.parent.name != journal.FAILURES
            name = path.parent.name if of_sample else path.stem
            if of_sample and scene_id(scene) != name:
                raise ValueError(f"{path} is not that of its sample: delete the folder and repeat the command of its "
                                 "sweep.")  # fmt: skip
            output = replace(scene.output, folder=str(root), overwrite=of_sample)
            asked = tuple(tried.get(name, {}).get("overrides", ()))
            tasks[path] = Task(replace(scene, output=output), asked)
        except ValueError as error:
            left.append(f"{path.relative_to(root)}: {error}")
    return tasks, left


def _cleared(attempts: dict[Path, Attempt]) -> int:
    """Delete the files in failures/ of attempts that succeeded or have failed under their id; count the former.

    The sweep itself deletes and replaces only those that are named by their id.
    """
    for path, attempt in attempts.items():
        elsewhere = attempt.failure and Path(attempt.failure) != path
        if path.parent.name == journal.FAILURES and (attempt.outcome.finished or elsewhere):
            path.unlink(missing_ok=True)
    return sum(attempt.outcome.finished for attempt in attempts.values())


def add(subparsers: Any) -> None:
    """The command `retry`."""
    command(subparsers, "retry", "run failed and broken draws again", __doc__, run)


def run(arguments: argparse.Namespace) -> int:
    """Print how many draws succeeded and why the others did not; returns 1 when there are others."""
    done, left = retry(arguments.folder, shown)
    for line in left:
        print(f"failed again  {line}")
    print(f"{done} succeeded, {len(left)} failed again")
    return int(bool(left))
