"""The terminal: a progress bar during a run, a table at its end."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar
from rich.table import Table

from fracsim.run.outcome import Outcome
from fracsim.run.signs import Signs
from fracsim.run.watcher import Watcher
from fracsim.scene.vocab import Scene

OUT = Console(highlight=False)
LABEL = 18
"""Columns for the names of the final table."""


class Progress(Watcher):
    """Feeds a progress bar: frames done, substeps a second, present dt."""

    def __init__(self, bar: ProgressBar, frames: int, fps: float) -> None:
        self._bar, self._fps = bar, fps
        self._task = bar.add_task("preparing", total=frames, rate="", dt="")
        self._since, self._done = time.perf_counter(), 0

    def note(self, text: str) -> None:
        """Print it above the bar."""
        self._bar.console.print(escape(text), soft_wrap=True)

    def substeps(self, done: int, dt: float, t: float) -> None:
        """Show the rate, twice a second at most."""
        now = time.perf_counter()
        if now - self._since > 0.5:
            rate = (done - self._done) / (now - self._since)
            self._since, self._done = now, done
            frames = 1 + t * self._fps
            self._bar.update(self._task, completed=frames, rate=f"{rate:.0f} substeps/s", dt=f"dt {dt:.2e} s")

    def frame(self, index: int) -> None:
        """Show the number of frames."""
        self._bar.update(self._task, completed=index + 1, description=f"frame {index + 1}")


@contextmanager
def progress(scene: Scene) -> Iterator[Watcher]:
    """A progress bar for the frames of a scene; when the output is no terminal, a line now and then on stderr."""
    if not OUT.is_terminal:
        yield Signs(scene.capture.frames, scene.capture.fps)
        return
    columns = (TextColumn("{task.description:<10}"), BarColumn(16), TextColumn("{task.percentage:>3.0f}%"),
               TimeRemainingColumn(), TextColumn("left  {task.fields[rate]}  {task.fields[dt]}"))  # fmt: skip
    with ProgressBar(*columns, console=OUT, transient=True) as bar:
        yield Progress(bar, scene.capture.frames, scene.capture.fps)


def heading(number: int, overrides: Sequence[str]) -> None:
    """Print which scene of a multirun is next."""
    OUT.print(f"\n[bold]scene {number}[/]  {escape(' '.join(overrides))}", soft_wrap=True)


def show(scene: Scene, outcome: Outcome, wall: float) -> None:
    """Print what happened in `wall` [s], and where the sample lies; nothing when no frame was finished."""
    if outcome.status == "existing":
        about = f", {outcome.reason}" if outcome.reason else "; output.overwrite=true makes it again"
        OUT.print(f"{escape(f'{outcome.path} is already there and whole{about}')}", soft_wrap=True)
    elif outcome.report:
        _table(scene, outcome, wall)


def _table(scene: Scene, outcome: Outcome, wall: float) -> None:
    """Print the report, the warnings and the paths."""
    t = Table(show_header=False, box=None, padding=(0, 0, 0, 0))
    t.add_column(style="bold", width=LABEL)
    t.add_column(overflow="fold")
    for name, value in (*_rows(scene, outcome.report), ("seconds", _seconds(outcome.seconds, wall))):
        t.add_row(name, escape(value))
    if outcome.frames < scene.capture.frames:
        t.add_row("INCOMPLETE", f"{outcome.frames} of {scene.capture.frames} frames")
    OUT.print(t)
    for warning in outcome.report["warnings"]:
        OUT.print(f"[yellow]{'warning':<{LABEL}}[/]{escape(warning)}", soft_wrap=True)
    assert outcome.path is not None
    for name, file in (("sample", outcome.path), ("to watch", outcome.path / "strip.mp4")):
        if file.exists():
            OUT.print(f"[bold]{name:<{LABEL}}[/]{escape(str(file))}", soft_wrap=True)


def _rows(scene: Scene, r: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """The rows of the final table."""
    what = Path(scene.asset.path).name or scene.asset.name
    yield "object", f"{what}, {r['particles']:,} particles, {scene.material.law}, {scene.solver.formulation}"
    yield "break", _break(scene, r)
    crit = r["lambda_crit"]
    changed = "" if crit == scene.fracture.crit else f", with the lambda_crit of these cells, {crit:.3g}"
    yield "a uniform bar", f"would break at a nominal stretch of {r['uniform_bar_breaks_at']:.2f}{changed}"
    yield "largest stretch", f"{r['stretch_max']:.2f}"
    yield "damaged / failed", f"{100 * r['damaged']:.2f} % / {100 * r['failed']:.2f} % of the particles"
    yield "peak load", f"{r['peak_load']:.4g} N"
    low, high = f"{r['dt_min']:.3g}", f"{r['dt_max']:.3g}"
    yield "substeps", f"{r['substeps']:,}, dt {low if low == high else f'{low} to {high}'} s"
    yield "energy [J]", _energy(r["energy"])


def _seconds(seconds: Mapping[str, float], wall: float) -> str:
    """Time by phase, and all of it; with a process beside it, frames are rendered and written while it simulates."""
    meanwhile = "" if "render" in seconds else ", rendered and written meanwhile"
    return ", ".join(f"{phase} {s:.1f}" for phase, s in seconds.items()) + f"{meanwhile}; all {wall:.1f}"


def _energy(e: Mapping[str, float]) -> str:
    """Work of grips and gravity, and where it went."""
    work = e["grip_work"] + e["gravity_work"]
    spent = (f"{k.replace('_', ' ')} {v:.3g}" for k, v in e.items() if v and k not in ("grip_work", "gravity_work"))
    return f"work {work:.4g} = {' + '.join(spent) or 0}".replace("+ -", "- ")


def _break(scene: Scene, r: Mapping[str, Any]) -> str:
    """When the object parted, and why."""
    frame = r["break_frame"] if r["break_frame"] is not None else r["torn_frame"]
    if frame is None:
        return "none, the object holds in the last frame"
    t = frame / scene.capture.fps
    stretch = 1 + 2 * scene.loading.speed * t / scene.loading.gauge
    how = "" if r["break_frame"] is not None else "NUMERICALLY TORN "
    return f"{how}at frame {frame} (t = {t:.3g} s, nominal stretch {stretch:.2f})"
