"""`python -m fracsim.bench`: measure, print a table and store it."""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path

from rich.console import Console

from fracsim.bench import memory, splatting, startup, substep
from fracsim.bench.plan import FULL, QUICK, Plan
from fracsim.bench.record import Row, table, write
from fracsim.entry import BAD, complain
from fracsim.lab.machine import machine

PARTS: dict[str, Callable[[Plan], Iterator[Row]]] = {
    "substep": substep.rows,
    "splatting": splatting.rows,
    "startup": startup.rows,
    "memory": memory.rows,
}
STUDIES = (
    "pareto",
    "published",
    "thresholds",
    "order",
    "mesh",
    "skips",
    "reading",
    "angles",
    "spectrum",
    "threads",
    "gpu",
)
"""Modules that take minutes and run only by name. Their `study(out, quick)` may also write a plot to `out`."""
FOLDER = Path("docs/benchmarks")


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """The parsed options; an unknown name is an error."""
    parser = argparse.ArgumentParser(prog="python -m fracsim.bench", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes without targets, to see whether it runs")
    names_help = f"what to measure: {', '.join(PARTS)} (default: all of these); {', '.join(STUDIES)} take minutes"
    parser.add_argument("names", metavar="NAME", nargs="*", help=names_help)
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"for the CSV file ({FOLDER})")
    options = parser.parse_args(argv)
    for name in options.names:
        if name not in (*PARTS, *STUDIES):
            parser.error(f"NAME={name} is not known: choose from {', '.join([*PARTS, *STUDIES])}.")
    return options


def measurement(name: str, options: argparse.Namespace) -> Iterator[Row]:
    """The rows of a part or a study. The module of a study is imported here, since it imports Taichi."""
    if name in PARTS:
        return PARTS[name](plan_of(options))
    found: Iterator[Row] = import_module(f"fracsim.bench.{name}").study(options.out, options.quick)
    return found


def plan_of(options: argparse.Namespace) -> Plan:
    """The sizes to measure."""
    return QUICK if options.quick else FULL


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print and store; 130 if interrupted. A missed target is marked in the table and is no error."""
    options, console = arguments(argv), Console(highlight=False, width=None if sys.stdout.isatty() else 132)
    size = plan_of(options).name
    console.print(", ".join(f"{name} {value}" for name, value in machine().items()), soft_wrap=True)
    names = options.names or list(PARTS)
    parts = [name for name in names if name in PARTS]
    some = (
        f"{'_'.join(parts)}_" if set(parts) < set(PARTS) else ""
    )  # an incomplete file does not replace a complete one
    rows: dict[str, list[Row]] = {}
    for k, name in enumerate(names, 1):
        console.print(f"measuring {name} ({k} of {len(names)}) ...")
        file = f"{some}{size}" if name in PARTS else f"{name}_{size}"
        rows.setdefault(file, [])
        with console.status(name) as status:
            try:
                for row in measurement(name, options):
                    status.update(f"{row.benchmark}: {row.variant}")
                    rows[file].append(row.without_target() if options.quick else row)
            except ValueError as error:
                complain(str(error))
                return BAD
            except KeyboardInterrupt:
                console.print(table(rows[file]))
                console.print(f"interrupted: {name} is not stored; files stored before remain", soft_wrap=True)
                return 130
        if name not in PARTS or name == parts[-1]:  # parts share a file; each study has its own
            console.print(table(rows[file]))
            console.print(f"stored in {write(rows[file], options.out, file)}", soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
