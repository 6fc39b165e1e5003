"""python -m fracsim.dataset: plan a data set, make its table and card, check it, mend it, copy it."""

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

COMMANDS = ("plan", "index", "verify", "retry", "card", "consistency", "export", "sheet")
"""Modules of fracsim.dataset with `add(subparsers)`, which sets the function to run as default `run`."""
BAD, INTERRUPTED = 2, 130
"""Exit statuses, beside 1 for a data set with something wrong."""


def parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    out = argparse.ArgumentParser(prog="python -m fracsim.dataset", description=__doc__)
    subparsers = out.add_subparsers(metavar="COMMAND", required=True)
    for name in COMMANDS:
        import_module(f"fracsim.dataset.{name}").add(subparsers)
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns 0, 1 when it found something wrong, 2 after an error, 130 after Ctrl-C."""
    given = parser().parse_args(arguments)
    try:
        return int(given.run(given))
    except (ValueError, OSError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD
    except KeyboardInterrupt:
        print("interrupted: repeat the command to go on", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
