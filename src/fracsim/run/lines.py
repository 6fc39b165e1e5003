"""The terminal during a sweep: one line a clip, and totals at the end."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.markup import escape

from fracsim.entry import complain
from fracsim.run import console
from fracsim.run.attempt import MADE, Attempt, Summary, Task
from fracsim.run.journal import Follower
from fracsim.run.outcome import Outcome
from fracsim.run.signs import duration
from fracsim.run.watcher import SweepWatcher, Watcher


class One(SweepWatcher):
    """A single scene: a progress bar, then the table."""

    @contextmanager
    def scene(self, task: Task) -> Iterator[Watcher]:
        """Show the progress of the run."""
        if task.scene is None:
            yield Watcher()
        else:
            with console.progress(task.scene) as bar:
                yield bar

    def done(self, attempt: Attempt) -> None:
        """Print the table, and the error if there is one."""
        if attempt.task.scene is not None:
            console.show(attempt.task.scene, attempt.outcome, attempt.wall)
        if attempt.outcome.status == "failed":
            complain(attempt.outcome.reason)


class Lines(SweepWatcher):
    """One line a clip.

    `job` is that of the sweeper (hydra_plugins.hydra_fracsim.draws.Job); `bar` shows the progress of each run as well,
    for the only process that writes to the terminal.
    """

    def __init__(self, job: Any, folder: Path, bar: bool) -> None:
        self._job, self._bar, self._number = job, bar, job.first
        self._follower = Follower(folder, job.journal)

    @contextmanager
    def scene(self, task: Task) -> Iterator[Watcher]:
        """Show the progress of the run, if wanted."""
        if task.scene is None or not self._bar:
            yield Watcher()
        else:
            with console.progress(task.scene) as bar:
                yield bar

    def done(self, attempt: Attempt) -> None:
        """Print the line of an attempt, and its error if there is one."""
        self._number += 1
        outcome = attempt.outcome
        times = [_times(attempt)] if outcome.status in MADE else []
        parts = [_ending(attempt), *times, *([] if outcome.status == "interrupted" else self._left())]
        line = f"{self._number}/{self._job.total} {label(attempt.task, self._job.varied)}: {', '.join(parts)}"
        console.OUT.print(escape(line), soft_wrap=True)
        if outcome.status == "failed":
            complain(outcome.reason)

    def _left(self) -> list[str]:
        """The time until the end, from the clips that all processes of the sweep have made."""
        made, left = self._follower.count(), self._job.total - self._number
        return [f"left {duration(left * (time.time() - self._job.began) / made)}"] if made and left > 0 else []


def label(task: Task, varied: Sequence[str]) -> str:
    """What distinguishes a scene in its sweep, as `duck draw 3`."""
    given = dict(override.lstrip("+").partition("=")[::2] for override in task.overrides)
    asset = task.scene.asset if task.scene else None
    name = (Path(asset.path).stem or asset.name) if asset else given.pop("asset", "")
    shown = [f"{key} {given[key]}" if key == "draw" else f"{key}={given[key]}" for key in varied if key in given]
    return " ".join([name, *(entry for entry in shown if not entry.startswith("asset="))]).strip() or "scene"


def _ending(attempt: Attempt) -> str:
    """How an attempt ended."""
    outcome: Outcome = attempt.outcome
    if outcome.status == "complete":
        return f"broke at frame {outcome.report['break_frame']}"
    if outcome.status == "suspect":
        return f"suspect ({outcome.reason})"
    if outcome.status == "failed":
        return f"failed, see {attempt.failure}"
    if outcome.status == "interrupted":
        return f"interrupted after {outcome.frames} frames"
    if outcome.status == "existing":
        return f"already there, {outcome.reason}" if outcome.reason else "already there"
    return outcome.status


def _times(attempt: Attempt) -> str:
    return f"{attempt.wall:.1f} s (simulate {attempt.outcome.seconds.get('simulate', 0.0):.1f})"


def totals(summary: Summary, seconds: float) -> None:
    """Print what came of a sweep that took `seconds` [s]."""
    c = summary.counts
    rate = f", {3600 * summary.made / seconds:.0f} clips/hour" if summary.made and seconds > 0 else ""
    line = (f"{c.total()} clips in {duration(seconds)}: made {summary.made} (suspect {c['suspect']}, never breaks "
            f"{c['never breaks']}), existing {c['existing']}, failed {summary.failed}{rate}")  # fmt: skip
    console.OUT.print(line, soft_wrap=True)
