"""Measured figures, as rows of a table and of a CSV file."""

import csv
import re
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from fracsim.lab.machine import machine


@dataclass(frozen=True)
class Row:
    """One figure; its target is `most` or `least`, or there is none."""

    benchmark: str
    variant: str
    value: float
    unit: str
    most: float | None = None
    least: float | None = None
    best: float | None = None
    """The most favourable repeat; `value` is the median of the repeats."""

    @property
    def target(self) -> str:
        """The target as text; empty without one."""
        if self.most is not None:
            return f"<= {self.most:g}"
        return "" if self.least is None else f">= {self.least:g}"

    @property
    def met(self) -> str:
        """`yes` or `no`; empty without a target."""
        if not self.target:
            return ""
        met = self.value <= self.most if self.most is not None else self.value >= (self.least or 0)
        return "yes" if met else "no"

    def without_target(self) -> "Row":
        """The same figure without its target, for a size to which the target does not apply."""
        return Row(self.benchmark, self.variant, self.value, self.unit, best=self.best)


def median(
    benchmark: str, variant: str, values: Sequence[float], unit: str, most: float | None = None,
    least: float | None = None,
) -> Row:  # fmt: skip
    """The row of repeated measurements: their median, and the most favourable one."""
    best = max(values) if least is not None else min(values)
    return Row(benchmark, variant, statistics.median(values), unit, most, least, best)


def write(rows: Iterable[Row], folder: Path, size: str) -> Path:
    """Store the rows as `<hardware>_<date>.csv`, with `size` in the name unless it is full; returns the path."""
    about = machine()
    hardware = re.sub(r"[^a-z0-9]+", "-", re.sub(r"\(.*?\)", "", about["cpu"]).lower()).strip("-")
    name = (
        f"{hardware}-x{about['cores']}_{about['date']}{'' if size == 'full' else '_' + size.removesuffix('_full')}.csv"
    )
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / name).open("w", newline="", encoding="utf-8") as file:
        columns = ("benchmark", "variant", "value", "best", "unit", "target", "met", "size")
        writer = csv.DictWriter(file, (*columns, *about))
        writer.writeheader()
        for row in rows:
            texts = {name: getattr(row, name) for name in ("benchmark", "variant", "unit", "target", "met")}
            best = "" if row.best is None else f"{row.best:.4g}"
            writer.writerow({**texts, "value": f"{row.value:.4g}", "best": best, "size": size, **about})
    return folder / name


def table(rows: Iterable[Row]) -> Table:
    """The rows as a readable table."""
    out = Table("benchmark", "what", title="median of the repeats, and the best of them")
    for name in ("value", "best"):
        out.add_column(name, justify="right")
    for name in ("unit", "target", "met"):
        out.add_column(name)
    last = ""
    for row in rows:
        colour = {"yes": "[green]", "no": "[red]", "": ""}[row.met]
        best = "" if row.best is None else f"{row.best:.4g}"
        name = "" if row.benchmark == last else row.benchmark
        out.add_row(name, row.variant, f"{row.value:.4g}", best, row.unit, row.target, colour + row.met)
        last = row.benchmark
    return out
