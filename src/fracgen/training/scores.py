"""The benchmark's metrics during training: observed clip by clip, gathered from all processes, logged and written.

`val/NAME` is a result over all clips, `val/CLASS/NAME` and `val/OBJECT/NAME` those of a group where there are several,
`val/count/clips/METRIC` how many clips were observed, `val/count/undefined/NAME` for how many a value is undefined.
"""

import csv
import io
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import torch.distributed as dist
from lightning import Trainer
from lightning.pytorch.loggers import WandbLogger

from fracgen.config.train import TrainConfig
from fracgen.data.index import Row
from fracgen.evaluation import choose
from fracgen.evaluation.clip import Pair
from fracgen.evaluation.metric import Metric, reduced
from fracgen.training.curves import log
from fracgen.training.ranks import rank
from fracgen.training.runs import write

TABLE = "clips.csv"
PARAMETERS = ("id", "split", "object", "class", "E", "nu", "onset", "crit", "axis_deg")
"""Columns of the cache's index that the table of clips begins with."""
KINDS = ("class", "object")
"""Groups of clips whose results are logged."""
Seen = dict[str, dict[str, Any]]
"""What was observed of a clip, by metric."""
T = TypeVar("T")


class Scores:
    """Metrics of clips with these numbers, whose rows in the index of the cache are `rows[number]`."""

    def __init__(self, metrics: Mapping[str, Metric], clips: Sequence[int], rows: Sequence[Row]) -> None:
        self.metrics, self.clips, self.rows = metrics, tuple(clips), rows
        self._seen: dict[int, Seen] = {}
        self._said: set[str] = set()

    def observe(self, number: int, pair: Pair) -> None:
        """Observe a clip by all metrics; a metric that cannot says so once, and the training goes on."""
        seen = self._seen.setdefault(number, {})
        for name, metric in self.metrics.items():
            try:
                seen[name] = metric.observe(pair)
            except ValueError as error:
                if name not in self._said:
                    print(f"validation: {name} is not measured of {pair.pred.name}: {error}", file=sys.stderr)
                self._said.add(name)

    def finish(self, trainer: Trainer, place: Path) -> None:
        """Log the results over the clips of all processes, which call this together, and write the table of clips."""
        together = gathered(self._seen)
        self._seen = {}
        seen = {number: together[number] for number in self.clips if number in together}
        if not trainer.is_global_zero:
            return
        log(trainer, dict(self.results(seen)))
        columns, lines = self.table(seen)
        write(place / TABLE, _csv(columns, lines))
        for logger in trainer.loggers:
            if isinstance(logger, WandbLogger):
                logger.log_table("val/clips", columns=columns, data=lines, step=trainer.global_step)

    def results(self, seen: Mapping[int, Seen]) -> Iterator[tuple[str, float]]:
        """Names and values of all that is logged; a result that is undefined is left out."""
        groups = {"val": list(seen)}
        for kind in KINDS:
            values = sorted({str(self.rows[number][kind]) for number in seen})
            members = {value: [n for n in seen if str(self.rows[n][kind]) == value] for value in values}
            groups |= {f"val/{value}": numbers for value, numbers in members.items() if len(values) > 1}
        for name, metric in self.metrics.items():
            mine = [observed[name] for observed in seen.values() if name in observed]
            if mine:
                yield f"val/count/clips/{name}", float(len(mine))
            for shown in metric.shown:
                undefined = sum(math.isnan(float(one[shown])) for one in mine)
                yield from [(f"val/count/undefined/{shown}", float(undefined))] * (undefined > 0)
            for group, numbers in groups.items():
                found = reduced(metric, [seen[number][name] for number in numbers if name in seen[number]])
                yield from ((f"{group}/{key}", value) for key, value in found.items() if math.isfinite(value))

    def table(self, seen: Mapping[int, Seen]) -> tuple[list[str], list[list[Any]]]:
        """Columns and rows: a clip a row with its parameters and its metrics, empty where undefined."""
        shown = [(name, column) for name, metric in self.metrics.items() for column in metric.shown]
        lines = [
            [*(self.rows[number][column] for column in PARAMETERS),
             *(_number(observed.get(name, {}).get(column)) for name, column in shown)]
            for number, observed in seen.items()
        ]  # fmt: skip
        return [*PARAMETERS, *(column for _, column in shown)], lines


def build(cfg: TrainConfig, streams: Sequence[str]) -> dict[str, Metric]:
    """The metrics of a configuration that can be computed from `streams`, by their names.

    Those that cannot, as weights or a package are missing, are named with the reason. Raises ValueError for a metric,
    a field or a value that is not allowed.
    """
    metrics: dict[str, Metric] = {}
    for choice in choose.choices(cfg.metric, cfg.measure.outside):
        try:
            metric = choice.build()
        except (ValueError, ImportError) as error:  # its fields are checked: what it rests on is not there
            _say(f"no {choice.name} in the validation: {error}")
            continue
        lacking = [stream for stream in metric.needs if stream not in streams]
        if lacking:
            _say(f"no {choice.name} in the validation: this stage has no {', '.join(lacking)}")
        else:
            metrics[choice.name] = metric
    return metrics


def gathered(mine: Mapping[int, T]) -> dict[int, T]:
    """What all processes have by number; they call this together."""
    if not (dist.is_available() and dist.is_initialized()):
        return dict(mine)
    parts: list[Any] = [None] * dist.get_world_size()
    dist.all_gather_object(parts, dict(mine))
    return {number: value for part in parts for number, value in part.items()}


def _number(value: Any) -> float | None:
    """A number of the table; None where it is undefined."""
    return None if value is None or math.isnan(float(value)) else float(value)


def _csv(columns: Sequence[str], lines: Sequence[Sequence[Any]]) -> str:
    """A table as text."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([[f"{v:.9g}" if isinstance(v, float) else v for v in line] for line in lines])
    return text.getvalue()


def _say(text: str) -> None:
    """Print in the first process."""
    if rank() == 0:
        print(text, file=sys.stderr)
