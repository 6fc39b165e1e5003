"""`python -m fracgen.bench`: measure, print a table and store it."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fracgen.bench.record import Row

PARTS = {
    "step": "time of a training step by checkpointing and precision, attention, share of the machine's peak",
    "loader": "reading clips against encoding them, waiting for them, Lightning against a plain loop",
    "memory": "peak memory of a training step against its plan",
    "skips": "what is saved by each computation that is left out where it is not needed",
    "overfit": "a run of +debug=overfit: loss against the first one, sampled clips against the true ones",
    "control": "does a run read its conditions: loss and scores with each of another clip",
    "pareto": "time of a sampled clip against its error, by solver, steps, precision, guidance, attention, tiles",
}
"""Modules of this package with `rows(quick)`; those of SAMPLED also take what is sampled from, and a folder."""
SAMPLED = ("pareto", "overfit", "control")
"""Parts that need a trained run; `--quick` takes random weights."""
FOLDER = Path("docs/benchmarks")


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """The parsed options; an unknown name is an error."""
    parser = argparse.ArgumentParser(prog="python -m fracgen.bench", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes, to see whether it runs")
    named = "; ".join(f"{name}: {about}" for name, about in PARTS.items())
    parser.add_argument("--run", default="", metavar="FOLDER", help="for pareto, overfit and control: a training")
    parser.add_argument("--vae", default="", metavar="FOLDER", help="their VAE, of vae=tiny")
    parser.add_argument("--clips", type=int, default=2, metavar="N", help="clips to sample (2)")
    parser.add_argument("--split", default="", help="their split, train or test (that of the training)")
    parser.add_argument(
        "names", metavar="NAME", nargs="*", help=f"what to measure (default: all that is possible): {named}"
    )
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"for the CSV files ({FOLDER})")
    options = parser.parse_args(argv)
    for name in options.names:
        if name not in PARTS:
            parser.error(f"NAME={name} is not known: choose from {', '.join(PARTS)}.")
        if name in SAMPLED and not (options.run or options.quick):
            parser.error(f"NAME={name} needs a trained network: give --run FOLDER and --vae FOLDER.")
    options.names = options.names or [name for name in PARTS if name not in SAMPLED or options.run or options.quick]
    return options


def measurement(name: str, options: argparse.Namespace) -> "Iterator[Row]":
    """The rows of a part, one by one as they are measured."""
    part, given = import_module(f"fracgen.bench.{name}"), []
    if name in SAMPLED:
        from fracgen.bench.field import Source

        given = [Source(options.run, options.vae, options.clips, options.split), options.out]
    found: Iterator[Row] = part.rows(options.quick, *given)
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print and store; 130 if interrupted, 2 for a run or clips that cannot be used.

    A missed target is marked in the table and is no error.
    """
    options = arguments(argv)

    from rich.console import Console

    from fracgen.bench.record import machine, table, write

    console = Console(highlight=False, width=None if sys.stdout.isatty() else 132)
    console.print(", ".join(f"{name} {value}" for name, value in machine().items()), soft_wrap=True)
    names = options.names
    for k, name in enumerate(names, 1):
        console.print(f"measuring {name} ({k} of {len(names)}) ...")
        rows: list[Row] = []
        with console.status(name) as status:
            try:
                for row in measurement(name, options):
                    status.update(f"{row.benchmark}: {row.variant}")
                    rows.append(row)
            except KeyboardInterrupt:
                console.print(table(rows))
                console.print(f"interrupted: {name} is not stored; files stored before remain", soft_wrap=True)
                return 130
            except ValueError as error:
                print(f"error: {error}", file=sys.stderr)
                return 2
        console.print(table(rows))
        console.print(f"stored in {write(rows, options.out, name, options.quick)}", soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
