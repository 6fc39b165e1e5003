"""`python -m fracsim.fuzz`: run and check scenes far beyond the published ranges."""

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


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """The parsed options."""
    parser = argparse.ArgumentParser(prog="python -m fracsim.fuzz", description=__doc__)
    parser.add_argument("--scenes", type=int, default=500, metavar="N", help="number of scenes to draw (500)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed and number determine a scene (0)")
    out_help = f"journal and wrong scenes; scenes in the journal are not run again ({FOLDER})"
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=out_help)
    parser.add_argument("--only", metavar="CLASS", nargs="+", choices=list(FAMILIES), help=", ".join(FAMILIES))
    parser.add_argument("--replay", type=Path, metavar="FILE", help="run the scene of a file again and explain it")
    parser.add_argument("--blowup", action="store_true", help="compare the substep that blows up with the bound")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Draw, run and print; returns 1 if a scene is wrong, 2 for a bad file, 130 if interrupted."""
    options, console = arguments(argv), Console(highlight=False, width=None if sys.stdout.isatty() else 132)
    try:
        if options.replay:
            return int(replay(options.replay, console).verdict == "wrong")
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    if options.blowup:
        return _blowup(console)
    return _study(options, console)


def _blowup(console: Console) -> int:
    """Print the ratios of blow-up to bound; returns 1 if one is outside its limits."""
    backend.start(Backend(threads=1))
    margins = []
    with _progress(console) as progress:
        for setting in progress.track(blowup.SETTINGS, description="blow-up"):
            margins.append(blowup.measure(setting))
    console.print(blowup.table(margins))
    return int(not all(margin.kept for margin in margins))


def _study(options: argparse.Namespace, console: Console) -> int:
    """Run the scenes that are not in the journal, then print the journal; returns 1 if a scene is wrong."""
    chosen = numbers(options.scenes, options.only or ())
    left = len(chosen) - len(journal(options.out, options.seed).keys() & set(chosen))
    if left < len(chosen):
        note = f"{len(chosen) - left} of {len(chosen)} scenes are in the journal of {options.out}, also if code changed"
        console.print(f"{note}: delete it, or use another --out, to run them again", soft_wrap=True)
    try:
        with _progress(console) as progress:
            task = progress.add_task("", total=left)
            for out in study(options.out, options.seed, chosen, Worker()):
                progress.update(task, advance=1, description=f"{out.family} {out.number} {out.verdict}")
    except KeyboardInterrupt:
        console.print("interrupted: repeat the command to continue", soft_wrap=True)
        return 130
    known = journal(options.out, options.seed)
    outcomes = [known[k] for k in chosen]
    console.print(table(outcomes))
    good = [o for o in outcomes if o.sensible]
    ended = [o for o in good if o.verdict == "finished"]
    console.print(f"{len(good)} are sensible: {len(ended)} finished, {sum(o.parted for o in ended)} of them parted",
                  soft_wrap=True)  # fmt: skip
    for line in lines(outcomes):
        console.print(line, soft_wrap=True)
    console.print(f"journal and wrong scenes in {options.out}", soft_wrap=True)
    return int(any(o.verdict == "wrong" for o in outcomes))


def _progress(console: Console) -> Progress:
    """A progress bar with an estimate of the time left; silent unless the console is a terminal."""
    return Progress(TextColumn("{task.description:<28}"), BarColumn(24), MofNCompleteColumn(), TimeRemainingColumn(),
                    console=console, transient=True, disable=not console.is_terminal)  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
