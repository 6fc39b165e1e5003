"""The sweeper of fracsim: all combinations of values, with the draws of a parameter table in jobs of at least 20.

`hydra/sweeper=draws`, which conf/simulate.yaml chooses. A job with many draws pays once for its start, its kernels and
its object. Any launcher runs the jobs.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override

DRAW, THREADS = "draw", "backend.threads"
"""The field whose values are put together in jobs; the field that is 1 in workers."""


@dataclass
class Job:
    """What a job must know about its sweep; the sweeper sets it."""

    total: int = 0
    """Scenes of the whole sweep."""
    first: int = 0
    """Scenes of the jobs before this one."""
    varied: list[str] = field(default_factory=list)
    """Fields and groups with more than one value."""
    began: float = 0.0
    """When the sweep began [s since 1970]."""
    journal: int = 0
    """Bytes in the journal when the sweep began."""


@dataclass
class DrawSweeperConf:
    """`hydra.sweeper`."""

    _target_: str = "hydra_plugins.hydra_fracsim.draws.DrawSweeper"
    params: dict[str, Any] | None = None
    """Fields and groups with their values, as FIELD: 1,2,3; the command line wins."""
    chunk: int = 20
    """Fewest draws of a job, where there are as many."""
    job: Job = field(default_factory=Job)


ConfigStore.instance().store(group="hydra/sweeper", name="draws", node=DrawSweeperConf, provider="fracsim")


class DrawSweeper(BasicSweeper):
    """Runs all combinations of values; a job has one combination and some draws."""

    def __init__(self, params: dict[str, Any] | None = None, chunk: int = 20, job: Any = None) -> None:
        super().__init__(max_batch_size=None, params=params)
        self._chunk = chunk

    def sweep(self, arguments: list[str]) -> Any:
        """Launch the jobs of a multirun; returns what each came to."""
        from fracsim.run import job

        assert self.config is not None and self.hydra_context is not None and self.launcher is not None  # noqa: PT018
        parser = OverridesParser.create(config_loader=self.hydra_context.config_loader)
        values = choices(parser.parse_overrides([*self._parse_config(), *arguments]))
        began, folder = time.time(), Path(self.config.hydra.sweep.dir)
        threads = [f"{THREADS}=1"] if self._in_workers() and not {THREADS, f"+{THREADS}"} & set(values) else []
        about = [f"hydra.sweeper.job.began={began}", f"hydra.sweeper.job.journal={job.journal_size(folder)}", *threads]
        jobs = [[*overrides, *about] for overrides in split(values, self._chunk)]
        # Jobs that differ in their draws are composed alike.
        self.validate_batch_is_legal(list({" ".join(j[: len(values)][:-1]): j for j in jobs}.values()))
        results = self.launcher.launch(jobs, initial_job_idx=0)
        job.finish([result.return_value for result in results], time.time() - began)
        return [results]

    def _in_workers(self) -> bool:
        """Whether the launcher starts processes."""
        assert self.config is not None
        return bool(self.config.hydra.runtime.choices["hydra/launcher"] != "basic")


def choices(overrides: Sequence[Override]) -> dict[str, list[str]]:
    """The overrides KEY=VALUE of each key, draws last; of several overrides of a key the last one counts."""
    values: dict[str, list[str]] = {}
    for override in overrides:
        values[override.get_key_element()] = [one for (one,) in BasicSweeper.split_arguments([override], None)[0]]
    if DRAW in values:
        values[DRAW] = values.pop(DRAW)
    return values


def split(values: dict[str, list[str]], chunk: int) -> Iterator[list[str]]:
    """The overrides of each job; jobs have from `chunk` to 2 `chunk` - 1 draws, or all that there are.

    The first len(values) of them are those of the user, the draws the last one of these.
    """
    # A value may be a list of draws.
    rows = [row for value in values.get(DRAW, ()) for row in value.partition("=")[2].strip("[]").split(",")]
    parts = list(chunks(rows, chunk)) if rows else [[]]
    others = [options for key, options in values.items() if key != DRAW]
    varied = [key.lstrip("+") for key, options in values.items() if len(options) > 1]
    varied += [DRAW] * (len(rows) > 1 and DRAW not in varied)
    each, first = max(len(rows), 1), 0
    total = each * prod(map(len, others))
    for combination, part in product(product(*others), parts):
        draws = [f"{DRAW}={part[0]}" if len(part) == 1 else f"{DRAW}=[{','.join(part)}]"] if part else []
        about = {"total": total, "first": first, "varied": f"[{','.join(varied)}]"}
        yield [*combination, *draws, *(f"hydra.sweeper.job.{name}={value}" for name, value in about.items())]
        first += max(len(part), 1)


def chunks(rows: Sequence[str], least: int) -> Iterator[list[str]]:
    """`rows` in order, in parts of about equal length, none shorter than `least`."""
    parts = max(len(rows) // least, 1)
    for i in range(parts):
        yield list(rows[i * len(rows) // parts : (i + 1) * len(rows) // parts])
