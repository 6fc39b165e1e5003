"""What follows a sweep clip by clip: `logger=none`, `logger=csv` (the default) or `logger=wandb`.

csv appends a row a clip to `multirun/SWEEP-HOST-PROCESS.csv` in the folder of the data set. wandb writes the same file,
and a run a process in the group of the sweep: how many clips are done and failed, the time left, seconds a clip by
phase, and a table with a row a clip, which has the parameters, a thumbnail and the preview video. It is offline unless
WANDB_API_KEY or WANDB_MODE say otherwise; `wandb sync multirun/wandb/offline-run-*` uploads later. What lies on disk
counts: wandb is a copy for people.
"""

import atexit
import csv
import os
import socket
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.util import Finalize
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from PIL import Image

from fracsim.records import Array
from fracsim.run.attempt import Attempt, Task
from fracsim.run.outcome import Outcome
from fracsim.run.watcher import SweepWatcher, Watcher
from fracsim.sample.identity import field_of, pinned_defaults, scene_id
from fracsim.sample.schema import STRIP
from fracsim.scene.knob import text
from fracsim.scene.vocab import Scene

LOGGERS = ("none", "csv", "wandb")
THUMBNAIL = 160
"""Width of a thumbnail in wandb [px]."""
PICTURES = ("thumbnail", "preview")
"""What wandb shows of a clip: a picture, and its strip.mp4."""
ROWS = 50
"""Rows after which the table of wandb is sent."""
PHASES = ("prepare", "simulate", "render", "write")
FIELDS = tuple(pinned_defaults(Scene))
"""Fields of a scene that are columns."""
COLUMNS = ("id", "status", "reason", "path", "frames", "break_frame", "torn_frame", "particles", "substeps", "seconds",
           *(f"seconds_{phase}" for phase in PHASES), *FIELDS)  # fmt: skip
"""Columns of the table of clips."""


class Logger(Protocol):
    """Is given each scene of a sweep that has been run."""

    def log(self, outcome: Outcome, scene: Scene | None) -> None:
        """Called after each scene, also after one that failed or was there already; None when it is not a scene."""

    def close(self) -> None:
        """Called at the end, also after Ctrl-C; a second call does nothing."""


_shared: dict[tuple[str, str, str], Logger] = {}
"""The loggers of this process."""


def shared(name: str, folder: str, sweep: str, total: int | None) -> Logger:
    """The logger that all jobs of a sweep in this process share, closed when the process ends; otherwise as `make`."""
    key = name, folder, sweep
    if key not in _shared:
        log = _shared[key] = make(name, folder, sweep, total)
        atexit.register(log.close)  # before that of wandb, which would end the run first
        Finalize(log, log.close, exitpriority=10)  # in workers of joblib, which skip atexit
    return _shared[key]


def make(name: str, folder: Path | str, sweep: str = "sweep", total: int | None = None) -> Logger:
    """The logger `name` of LOGGERS for this process and a sweep, of `total` scenes if all are run here.

    `folder` is that of the data set. Raises ValueError for an unknown name, and for wandb when it is not installed.
    """
    if name not in LOGGERS:
        raise ValueError(f"logger={name} is not known: choose one of {', '.join(LOGGERS)}.")
    if name == "none":
        return Silent()
    beside = Path(folder).expanduser() / "multirun"
    table = Csv(beside / f"{sweep}-{socket.gethostname()}-{os.getpid()}.csv")
    return table if name == "csv" else Wandb(table, beside, sweep, total)


class Logged(SweepWatcher):
    """Another watcher of a sweep, and a logger."""

    def __init__(self, watch: SweepWatcher, log: Logger) -> None:
        self._watch, self._log = watch, log

    @contextmanager
    def scene(self, task: Task) -> Iterator[Watcher]:
        """As the other watcher does."""
        with self._watch.scene(task) as follow:
            yield follow

    def done(self, attempt: Attempt) -> None:
        """Tell the other watcher and the logger."""
        self._watch.done(attempt)
        self._log.log(attempt.outcome, attempt.task.scene)


class Silent:
    """logger=none."""

    def log(self, outcome: Outcome, scene: Scene | None) -> None:
        """Does nothing."""

    def close(self) -> None:
        """Does nothing."""


class Csv:
    """logger=csv: a row a clip, on disk as soon as the clip is there."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        self._file = path.open("a", newline="", encoding="utf-8")
        self._writer = csv.DictWriter(self._file, COLUMNS)
        if not self._file.tell():
            self._writer.writeheader()

    def log(self, outcome: Outcome, scene: Scene | None) -> None:
        """Append the row of a clip."""
        self._writer.writerow(row_of(outcome, scene))
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class Wandb:
    """logger=wandb: a run a process, in the group of the sweep, beside the csv file."""

    def __init__(self, table: Csv, folder: Path, sweep: str, total: int | None) -> None:
        """Raises ValueError when wandb is not installed."""
        try:
            import wandb
        except ImportError:
            raise ValueError(
                "logger=wandb needs the package wandb: pip install 'fracsim[watch]', or set logger=csv."
            ) from None
        self._wandb, self._csv, self._total = wandb, table, total
        self._counts: Counter[str] = Counter()
        self._begin = time.perf_counter()
        self._run = wandb.init(
            project=os.environ.get("WANDB_PROJECT", "fracsim"), group=sweep, name=table.path.stem,
            job_type="sweep", dir=os.environ.get("WANDB_DIR", str(folder)), mode=_mode(),
            config={"sweep": sweep, "total": total}, settings=wandb.Settings(console="off", silent=True),
        )  # fmt: skip
        self._run.define_metric("sweep/done")
        self._run.define_metric("*", step_metric="sweep/done")
        self._table = wandb.Table(columns=[*COLUMNS, *PICTURES], log_mode="INCREMENTAL")
        self._unsent, self._closed = 0, False

    def log(self, outcome: Outcome, scene: Scene | None) -> None:
        """Log the curves and the row of a clip."""
        self._csv.log(outcome, scene)
        self._counts[outcome.status] += 1
        row = row_of(outcome, scene)
        pictures = self._pictures(outcome, row["id"])
        self._table.add_data(*(row[name] for name in COLUMNS), *(pictures.get(name) for name in PICTURES))
        # An offline run loses the pictures of its tables, so they are also logged on their own.
        self._run.log(self._curves(outcome, row) | {f"clip/{name}": p for name, p in pictures.items()})
        self._unsent += 1
        if self._unsent >= ROWS:
            self._send()

    def close(self) -> None:
        """Send what is left and finish the run."""
        if self._closed:
            return
        self._closed = True
        self._csv.close()
        if self._unsent:
            self._send()
        self._run.summary.update({f"status/{name}": n for name, n in self._counts.items()})
        self._run.finish()

    def _send(self) -> None:
        self._run.log({"clips": self._table})
        self._unsent = 0

    def _curves(self, outcome: Outcome, row: Mapping[str, Any]) -> dict[str, float]:
        """What is plotted over the number of clips."""
        done, spent = sum(self._counts.values()), time.perf_counter() - self._begin
        curves = {"sweep/done": done, "sweep/seconds": spent}
        curves |= {f"sweep/{name.replace(' ', '_')}": n for name, n in self._counts.items()}
        if self._total:
            curves["sweep/seconds_left"] = spent / done * (self._total - done)
        if outcome.status != "existing":
            curves |= {f"seconds/{phase}": s for phase, s in outcome.seconds.items()}
            names = ("seconds", "frames", "break_frame", "particles", "substeps")
            curves |= {f"clip/{name}": row[name] for name in names if row[name] is not None}
        return curves

    def _pictures(self, outcome: Outcome, identity: str) -> dict[str, Any]:
        """Those of PICTURES that a clip has."""
        if not outcome.finished or outcome.path is None:
            return {}
        out: dict[str, Any] = {}
        small, preview = thumbnail(outcome), outcome.path / STRIP
        if small is not None:
            out["thumbnail"] = self._wandb.Image(Image.fromarray(small), caption=identity)
        if preview.is_file():
            out["preview"] = self._wandb.Video(str(preview), caption=identity, format="mp4")
        return out


def _mode() -> Any:
    """offline, unless the environment says otherwise."""
    return os.environ.get("WANDB_MODE") or ("online" if os.environ.get("WANDB_API_KEY") else "offline")


def row_of(outcome: Outcome, scene: Scene | None) -> dict[str, Any]:
    """The row of a clip by COLUMNS; None where a failed run has no value."""
    seconds = outcome.seconds
    row: dict[str, Any] = {name: text(field_of(scene, name)) if scene else None for name in FIELDS}
    row |= {name: outcome.report.get(name) for name in ("break_frame", "torn_frame", "particles", "substeps")}
    row |= {f"seconds_{phase}": seconds.get(phase) for phase in PHASES}
    path = str(outcome.path) if outcome.path else ""
    return row | {"id": _id(scene), "status": outcome.status, "reason": outcome.reason, "path": path,
                  "frames": outcome.frames, "seconds": sum(seconds.values())}  # fmt: skip


def _id(scene: Scene | None) -> str:
    """The id of a scene, "" when there is none, or when the file of its object cannot be read."""
    try:
        return scene_id(scene) if scene else ""
    except ValueError:
        return ""


def thumbnail(outcome: Outcome) -> Array | None:
    """Colour at the break, or in the last frame, about THUMBNAIL pixels wide, [h, w, 3] uint8; None without colour."""
    sample = outcome.sample()
    if not sample.meta["rgb"]:
        return None
    broke = outcome.report.get("break_frame")
    frame = sample.frames - 1 if broke is None else min(int(broke), sample.frames - 1)
    (picture,) = sample.read("rgb", frame, frame + 1)
    factor = max(1, round(picture.shape[1] / THUMBNAIL))
    return np.asarray(Image.fromarray(picture).reduce(factor))
