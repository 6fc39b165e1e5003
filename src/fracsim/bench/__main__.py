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
from fracsim.lab.machine import machine

PARTS: dict[str, Callable[[Plan], Iterator[Row]]] = {
    "substep": substep.rows,
    "splatting": splatting.rows,
    "startup": startup.rows,
    "memory": memory.rows,
}
STUDIES = ("pareto", "published", "thresholds", "mesh", "skips", "reading")
"""Modules that take minutes and are run only when they are named; their `study(out, quick)` may draw a picture too."""
FOLDER = Path("docs/benchmarks")


def arguments(words: Sequence[str] | None) -> argparse.Namespace:
    """What the user wants."""
    parser = argparse.ArgumentParser(prog="python -m fracsim.bench", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes: does it run? (no targets)")
    told = f"what to measure: {', '.join(PARTS)} (all of them by default); {', '.join(STUDIES)} take minutes"
    parser.add_argument("names", metavar="NAME", nargs="*", help=told)
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"for the CSV file ({FOLDER})")
    wanted = parser.parse_args(words)
    for name in wanted.names:
        if name not in (*PARTS, *STUDIES):
            parser.error(f"NAME={name} is not known: choose from {', '.join([*PARTS, *STUDIES])}.")
    return wanted


def study(name: str) -> Callable[[Path, bool], Iterator[Row]]:
    """The study of this name, which brings Taichi along."""
    found: Callable[[Path, bool], Iterator[Row]] = import_module(f"fracsim.bench.{name}").study
    return found


def main(words: Sequence[str] | None = None) -> int:
    """Measure, print and store; a missed target is said in the table and is no error."""
    wanted, console = arguments(words), Console(highlight=False, width=None if sys.stdout.isatty() else 132)
    plan = QUICK if wanted.quick else FULL
    console.print(", ".join(f"{name} {value}" for name, value in machine().items()), soft_wrap=True)
    names = wanted.names or list(PARTS)
    parts = [name for name in names if name in PARTS]
    some = f"{'_'.join(parts)}_" if set(parts) < set(PARTS) else ""  # never in the place of the whole
    rows: dict[str, list[Row]] = {}
    for k, name in enumerate(names, 1):
        console.print(f"measuring {name} ({k} of {len(names)}) ...")
        file = f"{some}{plan.name}" if name in PARTS else f"{name}_{plan.name}"
        found = PARTS[name](plan) if name in PARTS else study(name)(wanted.out, wanted.quick)
        rows.setdefault(file, [])
        with console.status(name) as status:
            try:
                for row in found:
                    status.update(f"{row.benchmark}: {row.variant}")
                    rows[file].append(row.without_target() if wanted.quick else row)
            except KeyboardInterrupt:
                console.print(table(rows[file]))
                console.print(f"interrupted: {name} is not stored; what was stored before stays", soft_wrap=True)
                return 130
        if name not in PARTS or name == parts[-1]:  # the parts share a file; a study is stored before the next begins
            console.print(table(rows[file]))
            console.print(f"stored in {write(rows[file], wanted.out, file)}", soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
