"""What a sweep will hold and cost, without running it.

    python -m fracsim.dataset plan +sweep=table2
    python -m fracsim.dataset plan asset=bread 'draw=range(0,40)' --json plan.json
    python -m fracsim.dataset plan -m material.E=2e3,6e3 --no-calibrate

The words are those of `python -m fracsim`. Printed are the clips by object, class and split; how often each value
occurs; hours and GB from a calibration of about half a minute (`fracsim.dataset.calibrate`); and the frames in which
clips are predicted to break, by the closed form of a uniform bar (`fracsim.dataset.breaks`). The calibration prints
how late its own runs broke beside that.
"""

import argparse
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from fracsim.dataset import calibrate
from fracsim.dataset.breaks import breaking_frame, breaking_stretch
from fracsim.photo.stage import staged
from fracsim.sample.identity import field_of, pinned_defaults, scene_id
from fracsim.scene import expand
from fracsim.scene.classes import NONE, TRAINING_FRAMES, class_of, split_of
from fracsim.scene.knob import text
from fracsim.scene.vocab import Scene

BIN = 10
"""Frames in a row of the printed distribution."""
MOST_VALUES = 24
"""An axis with more values is printed as a range."""
BAR = 40
"""Width of the longest bar of the printed distribution."""
WIDE = 140
"""Columns of the tables when the output is no terminal."""


@dataclass(frozen=True)
class Planned:
    """One clip of a plan."""

    id: str
    object: str
    scene: Scene
    stretch: float
    """Nominal stretch at which a uniform bar breaks."""
    frame: int
    """Frame in which it breaks, which may lie beyond the last one."""

    @property
    def kind(self) -> str:
        """The material class."""
        named = class_of(self.object)
        return class_of(self.scene.material.law) if named == NONE else named


@dataclass(frozen=True)
class Plan:
    """The clips of a sweep; those of equal id are counted once, and listed as duplicates."""

    clips: list[Planned]
    duplicates: dict[str, int]
    """How often each id that is not alone occurs."""

    def counts(self) -> list[dict[str, Any]]:
        """Clips by object, class and split."""
        found = Counter((c.object, c.kind, split_of(c.object)) for c in self.clips)
        return [{"object": o, "class": k, "split": s, "clips": n} for (o, k, s), n in found.items()]

    def splits(self) -> dict[str, int]:
        """Clips by split."""
        return dict(Counter(split_of(c.object) for c in self.clips))

    def coverage(self) -> dict[str, dict[str, dict[str, int]]]:
        """Of each field that varies within an object, value -> object -> clips."""
        out: dict[str, dict[str, dict[str, int]]] = {}
        for name, values in self._varying.items():
            if len({(o, v) for o, v in values}) > len({o for o, _ in values}):
                table: dict[str, dict[str, int]] = {}
                for (o, v), n in sorted(Counter(values).items(), key=lambda item: _order(item[0][1])):
                    table.setdefault(v, {})[o] = n
                out[name] = table
        return out

    def by_object(self) -> list[str]:
        """Fields that vary between objects only."""
        covered = self.coverage()
        return [name for name in self._varying if name not in covered]

    @cached_property
    def _varying(self) -> dict[str, list[tuple[str, str]]]:
        """Of each field with several values, (object, value) of each clip."""
        names = [name for name in pinned_defaults(Scene) if not name.startswith("asset.")] if self.clips else []
        columns = {n: [text(field_of(c.scene, n)) for c in self.clips] for n in names}
        objects = [c.object for c in self.clips]
        return {n: list(zip(objects, v, strict=True)) for n, v in columns.items() if len(set(v)) > 1}

    def breaks(self) -> dict[str, dict[str, int]]:
        """By class and for all: clips that break within the training frames, later within the clip, and never."""
        out: dict[str, dict[str, int]] = {}
        for clip in self.clips:
            frames = clip.scene.capture.frames
            training = clip.frame < min(TRAINING_FRAMES, frames)
            when = "training" if training else "later" if clip.frame < frames else "never"
            for kind in (clip.kind, "all"):
                row = out.setdefault(kind, {"training": 0, "later": 0, "never": 0})
                row[when] += 1
        return out

    def frames(self) -> dict[int, Counter[str]]:
        """First frame of each bin of BIN frames -> class -> clips that break there, without those that never do."""
        bins: dict[int, Counter[str]] = {}
        for clip in self.clips:
            if clip.frame < clip.scene.capture.frames:
                bins.setdefault(clip.frame // BIN * BIN, Counter())[clip.kind] += 1
        return {start: bins.get(start, Counter()) for start in range(0, max(bins, default=-BIN) + BIN, BIN)}

    def cost(self, cost: calibrate.Cost) -> dict[str, float]:
        """Hours in one process and GB."""
        each = [cost.of(clip.scene) for clip in self.clips]
        return {"hours": sum(s for s, _ in each) / 3600, "gb": sum(b for _, b in each) / 1e9,
                "seconds_a_clip": sum(s for s, _ in each) / max(len(each), 1),
                "mb_a_clip": sum(b for _, b in each) / 1e6 / max(len(each), 1)}  # fmt: skip


def plan(scenes: Iterable[Scene]) -> Plan:
    """The plan of some scenes; starts Taichi. Raises ValueError when the file of an object cannot be read."""
    ids: Counter[str] = Counter()
    clips = []
    for scene in scenes:
        scene = staged(scene)
        identity = scene_id(scene)
        ids[identity] += 1
        if ids[identity] == 1:
            stretch = breaking_stretch(scene)
            clips.append(Planned(identity, object_of(scene), scene, stretch, breaking_frame(scene, stretch)))
    return Plan(clips, {identity: n for identity, n in ids.items() if n > 1})


def object_of(scene: Scene) -> str:
    """The name of the object, or of its file."""
    return scene.asset.name if scene.asset.kind == "builtin" else Path(scene.asset.path).stem


def _order(value: str) -> tuple[bool, float, str]:
    """Numbers by value, then texts."""
    try:
        return False, float(value), ""
    except ValueError:
        return True, 0.0, value


def add(subparsers: Any) -> None:
    """Add the command to `python -m fracsim.dataset`."""
    about = "counts, coverage, hours, GB and predicted break frames of a sweep, without running it"
    parser = subparsers.add_parser("plan", help=about, description=about)
    parser.add_argument("words", nargs="*", metavar="WORD", help="of python -m fracsim, as +sweep=table2 or draw=0,1")
    parser.add_argument("-m", "--multirun", action="store_true", help="allowed, and always on")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures there")
    parser.add_argument("--no-calibrate", action="store_true", help="use the figures of the last calibration")
    parser.set_defaults(run=main)


def main(arguments: argparse.Namespace) -> int:
    """Print the plan; returns 0. Raises ValueError for a word that cannot be used, or when no figures are stored."""
    from rich.console import Console

    out, err = Console(highlight=False), Console(stderr=True, highlight=False)
    if not out.is_terminal:
        out = Console(highlight=False, width=WIDE)
    scenes = expand.scenes(arguments.words)
    made = plan(scenes)
    cost = calibrate.stored() if arguments.no_calibrate else calibrate.calibrate(scenes, err.print)
    show(made, cost, out.print)
    if arguments.json:
        arguments.json.write_text(json.dumps(figures(made, cost), indent=1) + "\n", encoding="utf-8")
    return 0


def figures(made: Plan, cost: calibrate.Cost) -> dict[str, Any]:
    """All that is printed, for programs."""
    return {
        "clips": len(made.clips), "duplicates": made.duplicates, "counts": made.counts(), "splits": made.splits(),
        "coverage": made.coverage(), "differ_by_object": made.by_object(), "breaks": made.breaks(),
        "break_frames": {str(start): dict(n) for start, n in made.frames().items()},
        "cost": made.cost(cost), "calibration": asdict(cost),
    }  # fmt: skip


def show(made: Plan, cost: calibrate.Cost, say: Callable[[Any], None]) -> None:
    """Print the tables of a plan."""
    say(_counts(made))
    for identity, n in made.duplicates.items():
        say(f"[yellow]duplicate[/] {identity} occurs {n} times and is made once")
    if made.coverage():
        say(_coverage(made))
    if made.by_object():
        say(f"differ by object only: {', '.join(made.by_object())}")
    say(_breaks(made))
    say(_frames(made))
    for line in _cost(made, cost):
        say(line)


def _table(title: str, *columns: str, left: int = 1) -> Any:
    """A table; the first `left` columns are texts, the others numbers."""
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0), title_style="bold")
    for k, name in enumerate(columns):
        table.add_column(name, justify="left" if k < left else "right", no_wrap=True)
    return table


def _counts(made: Plan) -> Any:
    table = _table(f"{len(made.clips):,} clips", "object", "class", "split", "clips", left=3)
    for row in made.counts():
        table.add_row(row["object"], row["class"], row["split"], f"{row['clips']:,}")
    for split, n in made.splits().items():
        table.add_row("all", "", split, f"{n:,}")
    return table


def _coverage(made: Plan) -> Any:
    objects = list(dict.fromkeys(c.object for c in made.clips))
    table = _table("coverage: clips with each value", "field", "value", "all", *objects, left=2)
    for name, values in made.coverage().items():
        if len(values) > MOST_VALUES:
            first, *_, last = values
            values = {f"{len(values)} values, {first} to {last}": _sums(values.values())}
        for k, (value, n) in enumerate(values.items()):
            counts = (f"{n[o]:,}" if o in n else "-" for o in objects)
            table.add_row("" if k else name, value, f"{sum(n.values()):,}", *counts)
    return table


def _sums(rows: Iterable[Mapping[str, int]]) -> dict[str, int]:
    total: Counter[str] = Counter()
    for row in rows:
        total.update(row)
    return dict(total)


def _breaks(made: Plan) -> Any:
    first, last = f"within frames 0 to {TRAINING_FRAMES - 1}", "later in the clip"
    table = _table("predicted breaks", "class", first, last, "never", "clips")
    for kind, n in sorted(made.breaks().items(), key=lambda item: item[0] == "all"):
        total = sum(n.values())
        table.add_row(kind, *(f"{v:,} ({v / total:.0%})" for v in n.values()), f"{total:,}")
    return table


def _frames(made: Plan) -> Any:
    bins, kinds = made.frames(), list(dict.fromkeys(c.kind for c in made.clips))
    table = _table("predicted break frames", "frames", *kinds, "all", "")
    table.columns[-1].justify = "left"
    most = max((sum(n.values()) for n in bins.values()), default=1)
    for start, n in bins.items():
        total = sum(n.values())
        bar = "#" * math.ceil(BAR * total / max(most, 1))
        table.add_row(f"{start} to {start + BIN - 1}", *(f"{n[k]:,}" for k in kinds), f"{total:,}", bar)
    return table


def _doubt(about: Mapping[str, Any]) -> str:
    busy = about.get("busy_cores", 0.0)
    return f"; measured while other processes kept {busy:.1f} cores busy" if busy > calibrate.BUSY else ""


def _cost(made: Plan, cost: calibrate.Cost) -> Sequence[str]:
    total, about = made.cost(cost), cost.about
    growth = ", ".join(f"{law} {factor:.2f}" for law, factor in cost.growth.items())
    return (
        f"[bold]{total['hours']:,.1f} hours[/] in one process with {about['threads']} thread(s) here, "
        f"{total['seconds_a_clip']:.1f} s a clip",
        f"[bold]{total['gb']:,.1f} GB[/], {total['mb_a_clip']:.1f} MB a clip of {', '.join(about['recorded'])}",
        f"model of {about['date']}: seconds = {cost.clip:.2f} + substeps ({cost.substep:.2e} + {cost.particle:.2e} "
        f"particles) + frames ({cost.pixel:.2e} pixels + {cost.splat:.2e} particles); "
        f"substeps of a pull over those at rest: {growth}",
        f"error on a scene that did not fit it: {cost.error:+.0%} (predicted {about['predicted_s']:.1f} s, "
        f"measured {about['measured_s']:.1f} s){_doubt(about)}",
        *(f"{run['object']} on {run['cells']} cells broke in frame {run['break_frame']}, predicted "
          f"{run['predicted_frame']}" for run in about["runs"] if run["break_frame"] is not None),
    )  # fmt: skip
