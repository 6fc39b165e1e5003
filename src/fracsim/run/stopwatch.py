"""Seconds by phase of a run."""

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")


class Stopwatch:
    """Adds up wall-clock seconds under names: `with watch("render"): ...`."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)

    @contextmanager
    def __call__(self, phase: str) -> Iterator[None]:
        """Time the body of a `with` statement."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[phase] += time.perf_counter() - start

    def timed(self, phase: str, items: Iterable[T]) -> Iterator[T]:
        """Yield the items, and add the time that each one takes to `phase`."""
        source = iter(items)
        while True:
            with self(phase):
                try:
                    item = next(source)
                except StopIteration:
                    return
            yield item
