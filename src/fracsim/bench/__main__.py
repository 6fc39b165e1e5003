"""`python -m fracsim.bench`: measure, print a table and store it."""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from rich.console import Console

from fracsim.bench import memory, splatting, startup, substep
from fracsim.bench.plan import FULL, QUICK, Plan
from fracsim.bench.record import Row, machine, table, write

PARTS: dict[str, Callable[[Plan], Iterator[Row]]] = {
    "substep": substep.rows,
    "splatting": splatting.rows,
    "startup": startup.rows,
    "memory": memory.rows,
}
FOLDER = Path("docs/benchmarks")


def arguments(words: Sequence[str] | None) -> argparse.Namespace:
    """What the user wants."""
    parser = argparse.ArgumentParser(prog="python -m fracsim.bench", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes: does it run? (no targets)")
    parser.add_argument("--only", metavar="NAME", nargs="+", choices=list(PARTS), help=", ".join(PARTS))
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"for the CSV file ({FOLDER})")
    return parser.parse_args(words)


def main(words: Sequence[str] | None = None) -> int:
    """Measure, print and store; a missed target is said in the table and is no error."""
    wanted, console = arguments(words), Console(highlight=False, width=None if sys.stdout.isatty() else 132)
    plan = QUICK if wanted.quick else FULL
    console.print(", ".join(f"{name} {value}" for name, value in machine().items()), soft_wrap=True)
    rows: list[Row] = []
    parts = wanted.only or list(PARTS)
    for k, name in enumerate(parts, 1):
        console.print(f"measuring {name} ({k} of {len(parts)}) ...")
        rows += PARTS[name](plan)
    if wanted.quick:
        rows = [row.without_target() for row in rows]
    console.print(table(rows))
    console.print(f"stored in {write(rows, wanted.out, plan.name)}", soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
