"""How far a long command is, with an estimate of the time left; only in a terminal."""

import sys
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

T = TypeVar("T")
Progress = Callable[[Iterable[Any], int, str], Iterable[Any]]
"""Passes items on and shows how many of a total are done, under a heading."""


def silent(items: Iterable[T], total: int, heading: str) -> Iterable[T]:
    """The items; shows nothing."""
    return items


def shown(items: Iterable[T], total: int, heading: str) -> Iterator[T]:
    """The items, while a bar on the error stream shows how many of `total` are done and how long the rest will take."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    out = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(16), MofNCompleteColumn(), TimeRemainingColumn(),
               TextColumn("left"))  # fmt: skip
    with Progress(*columns, console=out, transient=True, disable=not sys.stderr.isatty()) as bar:
        yield from bar.track(items, total=total, description=heading)
