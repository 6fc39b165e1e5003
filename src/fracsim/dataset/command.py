"""How a module becomes a command of `python -m fracsim.dataset`."""

import argparse
from collections.abc import Callable
from typing import Any


def command(
    subparsers: Any, name: str, about: str, description: str | None, run: Callable[[argparse.Namespace], int]
) -> argparse.ArgumentParser:
    """Add a command that takes the folder of a data set; returns its parser, for more arguments."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        name, help=about, description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", metavar="DIR", help="folder of the data set")
    parser.set_defaults(run=run)
    return parser
