"""`python -m fracgen.stress`: inputs at the edge of what is allowed give finite numbers, or are refused by name."""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

    from fracgen.stress.case import Case, Outcome

GROUPS = {
    "network": "noise levels at their ends, wild latents, half precision",
    "videos": "black maps, constant clips, through the VAE into a cache",
    "training": "learning rates, broken caches, few and short clips",
    "sampling": "steps, guidance, captions, pictures, conditions",
}
"""Modules of this package with `cases()`."""
WIDTH = 120
"""Longest reason that is shown [characters]."""


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """The parsed options; an unknown group is an error."""
    parser = argparse.ArgumentParser(prog="python -m fracgen.stress", description=__doc__)
    named = "; ".join(f"{name}: {about}" for name, about in GROUPS.items())
    parser.add_argument("groups", metavar="GROUP", nargs="*", help=f"what to try (default: all): {named}")
    parser.add_argument("--fast", action="store_true", help="leave out what takes longer")
    options = parser.parse_args(argv)
    for name in options.groups:
        if name not in GROUPS:
            parser.error(f"GROUP={name} is not known: choose from {', '.join(GROUPS)}.")
    return options


def main(argv: Sequence[str] | None = None) -> int:
    """Try, and print a table; 1 if a case is wrong, 130 if interrupted."""
    options = arguments(argv)

    from rich.console import Console

    from fracgen.stress.case import WRONG

    console = Console(highlight=False, width=None if sys.stdout.isatty() else 160)
    found: list[tuple[Case, Outcome]] = []
    try:
        for case, outcome in tried(options.groups or list(GROUPS), options.fast, console.is_terminal):
            found.append((case, outcome))
    except KeyboardInterrupt:
        console.print(table(found))
        return 130
    console.print(table(found))
    wrong = sum(outcome.verdict == WRONG for _, outcome in found)
    console.print(f"{len(found)} cases, {wrong} wrong")
    return int(wrong > 0)


def tried(groups: Sequence[str], fast: bool, shown: bool = False) -> "list[tuple[Case, Outcome]]":
    """The cases of groups, and what came of them."""
    from rich.progress import track

    from fracgen.stress.case import judge
    from fracgen.stress.place import prepare

    chosen: list[Case] = [
        case for name in groups for case in import_module(f"fracgen.stress.{name}").cases() if not (fast and case.slow)
    ]
    with tempfile.TemporaryDirectory() as folder:
        place = prepare(Path(folder) / "place")
        return [(case, judge(case, place, Path(folder) / f"case{k}"))
                for k, case in enumerate(track(chosen, "trying", disable=not shown))]  # fmt: skip


def table(found: "Sequence[tuple[Case, Outcome]]") -> "Table":
    """Cases and outcomes."""
    from rich.markup import escape
    from rich.table import Table

    out = Table("case", "outcome", title="finite, or refused by name")
    out.add_column("s", justify="right")
    out.add_column("why")
    for case, outcome in found:
        reason = outcome.reason.splitlines()[0] if outcome.reason else ""
        short = reason if len(reason) <= WIDTH else f"{reason[: WIDTH - 3]}..."
        out.add_row(case.name, outcome.verdict, f"{outcome.seconds:.1f}", escape(short))
    return out


if __name__ == "__main__":
    sys.exit(main())
