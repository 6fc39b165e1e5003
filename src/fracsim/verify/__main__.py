"""`python -m fracsim.verify`: problems with known answers, as a table, a CSV file and plots of convergence."""

import argparse
import csv
import dataclasses
import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from fracsim import backend
from fracsim.lab.machine import machine
from fracsim.scene.vocab import Backend
from fracsim.verify import plots, problem
from fracsim.verify.problem import Check, Setting

FOLDER = Path("docs/verification")
QUALITIES = ("default", "preview", "paper", "reference")
COLUMNS = ("problem", "formulation", "quantity", "exact", "measured", "error", "tolerance", "ok", "unit", "axis", "at",
           "seconds")  # fmt: skip


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """The parsed options."""
    parser = argparse.ArgumentParser(prog="python -m fracsim.verify", description=__doc__)
    parser.add_argument("--quality", default="default", choices=QUALITIES, help="preset whose solver fields are used")
    parser.add_argument("--formulation", choices=(*problem.FORMULATIONS, "both"), help="default: that of the quality")
    parser.add_argument("--precision", choices=("float32", "float64"), help="default: that of the quality")
    parser.add_argument("--only", metavar="NAME", nargs="+", choices=problem.names(), help=", ".join(problem.names()))
    parser.add_argument("--quick", action="store_true", help="small sizes and few refinements, in about a minute")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"for CSV and plots ({FOLDER})")
    return parser.parse_args(argv)


def settings(options: argparse.Namespace) -> list[Setting]:
    """One setting for each formulation."""
    preset = problem.preset(options.quality)
    if options.precision:
        preset = dataclasses.replace(preset, precision=options.precision)
    form = options.formulation or preset.formulation
    forms = problem.FORMULATIONS if form == "both" else (form,)
    return [Setting(preset, form, options.quick) for form in forms]


def checks(names: Sequence[str], under: Sequence[Setting], progress: Progress) -> Iterator[Check]:
    """The checks of all problems under all settings."""
    pairs = [(name, s) for name in names for s in under if problem.suits(name, s.formulation)]
    task = progress.add_task("", total=len(pairs))
    for name, setting in pairs:
        progress.update(task, description=f"{name}, {setting.formulation}")
        yield from problem.run(name, setting)
        progress.advance(task)


def number(value: float | None) -> str:
    """A number with five digits; empty for None or NaN."""
    return "" if value is None or math.isnan(value) else f"{value:.5g}"


def table(rows: Iterable[Check]) -> Table:
    """The checks as a readable table."""
    out = Table("problem", "formulation", "quantity")
    for name in ("exact", "measured", "error", "tolerance"):
        out.add_column(name, justify="right", no_wrap=True)
    out.add_column("ok")
    out.add_column("seconds", justify="right")
    last = ("", "")
    for row in rows:
        name, form = row.problem, row.formulation
        head = ("", "") if (name, form) == last else (name, form)
        colour = {"yes": "[green]", "no": "[red]", "": ""}[row.ok]
        unit = "" if row.unit == "1" else f" [{row.unit}]"
        error = number(row.error) and f"{row.error:.2g}"
        out.add_row(*head, row.quantity + unit.replace("[", r"\["), number(row.exact), number(row.measured), error,
                    number(row.tolerance), colour + row.ok, f"{row.seconds:.1f}")  # fmt: skip
        last = name, form
    return out


def write(rows: Iterable[Check], folder: Path, name: str, quality: str) -> Path:
    """Store the checks as a CSV file with hardware, versions and commit; returns its path."""
    about = machine()
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
        out = csv.DictWriter(file, (*COLUMNS, "quality", *about))
        out.writeheader()
        for row in rows:
            values = {name: getattr(row, name) for name in COLUMNS}
            shown = {k: number(v) if isinstance(v, float) or v is None else v for k, v in values.items()}
            out.writerow({**shown, "seconds": f"{row.seconds:.2f}", "quality": quality, **about})
    return folder / f"{name}.csv"


def main(argv: Sequence[str] | None = None) -> int:
    """Run, print and store; 130 if interrupted. A missed tolerance is marked in the table and is no error."""
    options, console = arguments(argv), Console(highlight=False, width=None if sys.stdout.isatty() else 150)
    parts = [options.quality, *([options.precision] if options.precision else []), *["quick"] * options.quick]
    label = "_".join(parts)
    backend.start(Backend(threads=1))
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        rows: list[Check] = []
        try:
            rows.extend(checks(options.only or problem.names(), settings(options), progress))
        except KeyboardInterrupt:
            console.print(table(rows))
            path = write(rows, options.out, f"{label}_part", options.quality)
            console.print(f"interrupted: stored in {path}; use --only NAME ... for the other problems", soft_wrap=True)
            return 130
    console.print(table(rows))
    label += "_part" * bool(options.only)  # an incomplete file does not replace a complete one
    path = write(rows, options.out, label, options.quality)
    drawn = plots.draw(rows, options.out)
    met, asked = sum(row.ok == "yes" for row in rows), sum(row.ok != "" for row in rows)
    console.print(f"{met} of {asked} tolerances met; stored in {path} and {len(drawn)} plots", soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
