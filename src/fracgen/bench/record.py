"""Measured figures, as rows of a table and of a CSV file."""

import csv
import datetime
import os
import platform
import re
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from fracsim.sample.provenance import provenance


@dataclass(frozen=True)
class Row:
    """One figure; `target` is the largest or the least value that it should have, or there is none."""

    benchmark: str
    variant: str
    value: float
    unit: str
    most: float | None = None
    least: float | None = None
    best: float | None = None
    """The smallest of the repeats; `value` is their median."""

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


def median(benchmark: str, variant: str, values: Sequence[float], unit: str, most: float | None = None) -> Row:
    """The row of repeated measurements."""
    return Row(benchmark, variant, statistics.median(values), unit, most, best=min(values))


def machine() -> dict[str, str]:
    """The columns that are the same for all rows: hardware, versions, commit, date."""
    import torch

    versions = provenance()
    commit = (versions["git_commit"] or "unknown")[:12] + ("+dirty" if versions["git_dirty"] else "")
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else ""
    return {
        "device": gpu or processor(), "cores": str(os.cpu_count()), "threads": str(torch.get_num_threads()),
        "load": f"{os.getloadavg()[0]:.1f}", "python": str(versions["python"]), "torch": torch.__version__,
        "commit": commit, "date": datetime.date.today().isoformat(),
    }  # fmt: skip


def processor() -> str:
    """The model of the processor as the system names it."""
    try:
        named = re.search(r"model name\s*:\s*(.+)", Path("/proc/cpuinfo").read_text())
    except OSError:
        named = None
    return named[1].strip() if named else platform.processor() or platform.machine()


def write(rows: Iterable[Row], folder: Path, name: str, quick: bool) -> Path:
    """Store the rows as `<device>_<date>_gen_<name>.csv`, with `quick` in the name if they are; returns the path."""
    about = machine()
    device = re.sub(r"[^a-z0-9]+", "-", re.sub(r"\(.*?\)", "", about["device"]).lower()).strip("-")
    path = folder / f"{device}-x{about['cores']}_{about['date']}_gen_{name}{'_quick' if quick else ''}.csv"
    folder.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.part")
    with unfinished.open("w", newline="", encoding="utf-8") as file:
        columns = ("benchmark", "variant", "value", "best", "unit", "target", "met")
        writer = csv.DictWriter(file, (*columns, *about))
        writer.writeheader()
        for row in rows:
            texts = {column: getattr(row, column) for column in ("benchmark", "variant", "unit", "target", "met")}
            best = "" if row.best is None else f"{row.best:.4g}"
            writer.writerow({**texts, "value": f"{row.value:.4g}", "best": best, **about})
    os.replace(unfinished, path)
    return path


def table(rows: Iterable[Row]) -> Table:
    """The rows as a readable table."""
    out = Table("benchmark", "what", title="median of the repeats, and the smallest of them")
    for name in ("value", "best"):
        out.add_column(name, justify="right")
    for name in ("unit", "target", "met"):
        out.add_column(name)
    last = ""
    for row in rows:
        best = "" if row.best is None else f"{row.best:.4g}"
        out.add_row("" if row.benchmark == last else row.benchmark, row.variant, f"{row.value:.4g}", best, row.unit,
                    row.target, row.met)  # fmt: skip
        last = row.benchmark
    return out
