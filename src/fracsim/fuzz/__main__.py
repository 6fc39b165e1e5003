"""`python -m fracsim.fuzz`: does it hold, far beyond the published ranges?"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from fracsim import backend
from fracsim.fuzz import blowup
from fracsim.fuzz.draw import FAMILIES
from fracsim.fuzz.replay import replay
from fracsim.fuzz.study import Worker, journal, numbers, study
from fracsim.fuzz.table import lines, table
from fracsim.scene.vocab import Backend

FOLDER = Path("stress")


def arguments(words: Sequence[str] | None) -> argparse.Namespace:
    """What the user wants."""
    parser = argparse.ArgumentParser(prog="python -m fracsim.fuzz", description=__doc__)
    parser.add_argument("--scenes", type=int, default=500, metavar="N", help="how many are drawn (500)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="scene k of seed s is always the same (0)")
    out_help = f"journal and wrong scenes; what is in the journal is not run again ({FOLDER})"
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=out_help)
    parser.add_argument("--only", metavar="CLASS", nargs="+", choices=list(FAMILIES), help=", ".join(FAMILIES))
    parser.add_argument("--replay", type=Path, metavar="FILE", help="run the scene of a file again and explain it")
    parser.add_argument("--blowup", action="store_true", help="find the substep that blows up, beside the bound")
    return parser.parse_args(words)


def main(words: Sequence[str] | None = None) -> int:
    """Draw, run and print; 1 when something is wrong."""
    wanted, console = arguments(words), Console(highlight=False, width=None if sys.stdout.isatty() else 132)
    try:
        if wanted.replay:
            return int(replay(wanted.replay, console).verdict == "wrong")
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    if wanted.blowup:
        return _blowup(console)
    return _study(wanted, console)


def _blowup(console: Console) -> int:
    """Print the ratios; 1 when one is below what it has to reach."""
    backend.start(Backend(threads=1))
    rows = []
    with _bar(console) as bar:
        for setting in bar.track(blowup.SETTINGS, description="blow-up"):
            rows.append(blowup.measure(setting))
    console.print(blowup.table(rows))
    return int(not all(row.kept for row in rows))


def _study(wanted: argparse.Namespace, console: Console) -> int:
    """Run what is not in the journal yet and print the journal."""
    chosen = numbers(wanted.scenes, wanted.only or ())
    left = len(chosen) - len(journal(wanted.out, wanted.seed).keys() & set(chosen))
    if left < len(chosen):
        told = f"{len(chosen) - left} of {len(chosen)} scenes are known from {wanted.out}, whatever has changed since"
        console.print(f"{told}: delete it, or use another --out, to run them again", soft_wrap=True)
    try:
        with _bar(console) as bar:
            task = bar.add_task("", total=left)
            for out in study(wanted.out, wanted.seed, chosen, Worker()):
                bar.update(task, advance=1, description=f"{out.family} {out.number} {out.verdict}")
    except KeyboardInterrupt:
        console.print("interrupted: repeat the command to go on", soft_wrap=True)
        return 130
    known = journal(wanted.out, wanted.seed)
    outcomes = [known[k] for k in chosen]
    console.print(table(outcomes))
    good = [o for o in outcomes if o.sensible]
    ended = [o for o in good if o.verdict == "finished"]
    console.print(f"{len(good)} are sensible: {len(ended)} finished, {sum(o.parted for o in ended)} of them parted",
                  soft_wrap=True)  # fmt: skip
    for line in lines(outcomes):
        console.print(line, soft_wrap=True)
    console.print(f"journal and wrong scenes in {wanted.out}", soft_wrap=True)
    return int(any(o.verdict == "wrong" for o in outcomes))


def _bar(console: Console) -> Progress:
    """A progress bar with an estimate; silent when nobody watches."""
    return Progress(TextColumn("{task.description:<28}"), BarColumn(24), MofNCompleteColumn(), TimeRemainingColumn(),
                    console=console, transient=True, disable=not console.is_terminal)  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
