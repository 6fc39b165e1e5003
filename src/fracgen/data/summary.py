"""What came of an encoding, counted while it goes on and told at its end."""

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

from torch import Tensor

MB = 2**20
EVERY = 60.0
"""Time between two lines about how far it is, where there is no terminal [s]."""
MEAN, STD = 0.5, (0.5, 2.0)
"""Largest mean, and least and largest standard deviation, that latents of a VAE with the right statistics have."""


@dataclass
class Summary:
    """Counts of one encoding."""

    asked: int
    """Clips that can be used."""
    todo: int
    """Those of them that were not in the cache."""
    done: int = 0
    bytes: int = 0
    seconds: float = 0.0
    left_out: dict[str, list[str]] = field(default_factory=dict)
    """Ids of clips that cannot be used, by the reason."""
    moments: dict[str, tuple[int, float, float]] = field(default_factory=dict)
    """Count, sum and sum of squares of the latents of each stream."""

    def count(self, latents: Mapping[str, Tensor]) -> None:
        """Take account of the latents of a clip, by stream."""
        for name, latent in latents.items():
            n, one, two = self.moments.get(name, (0, 0.0, 0.0))
            x = latent.double()
            self.moments[name] = (n + x.numel(), one + float(x.sum()), two + float((x * x).sum()))

    def statistics(self) -> dict[str, tuple[float, float]]:
        """Mean and standard deviation of the latents of each stream."""
        return {
            name: (one / n, max(two / n - (one / n) ** 2, 0) ** 0.5) for name, (n, one, two) in self.moments.items()
        }

    def odd(self) -> str:
        """A warning when latents are not of mean near 0 and standard deviation near 1, else empty."""
        names = [f"{name} ({mean:+.2f}, {std:.2f})" for name, (mean, std) in self.statistics().items()
                 if abs(mean) > MEAN or not STD[0] <= std <= STD[1]]  # fmt: skip
        if not names:
            return ""
        return (f"warning: mean and standard deviation of latents should be about 0 and 1, but those of "
                f"{', '.join(names)} are not: is the VAE trained, and are its statistics right?")  # fmt: skip

    def rate(self) -> str:
        """How fast it goes."""
        seconds = max(self.seconds, 1e-9)
        return f"{self.done / seconds:.2g} clips/s, {self.bytes / MB:.3g} MB"


class Progress:
    """Shows how far an encoding is, with an estimate: a bar in a terminal, a line a minute elsewhere; a context."""

    def __init__(self, summary: Summary) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        self.summary, self._start, self._told = summary, time.monotonic(), time.monotonic()
        columns = (TextColumn("encoding"), BarColumn(16), MofNCompleteColumn(), TextColumn("{task.fields[rate]}"),
                   TimeRemainingColumn(), TextColumn("left"))  # fmt: skip
        self._bar: Any = Bar(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty())
        self._task = self._bar.add_task("", total=summary.todo, rate="")

    def step(self) -> None:
        """Another clip is done, or cannot be."""
        summary, now = self.summary, time.monotonic()
        summary.seconds = now - self._start
        self._bar.update(self._task, advance=1, rate=summary.rate())
        if self._bar.disable and now - self._told > EVERY:
            left = summary.seconds / max(summary.done, 1) * (summary.todo - summary.done)
            line = f"{summary.done} of {summary.todo} clips, {summary.rate()}, {left / 60:.0f} min left"
            print(line, file=sys.stderr, flush=True)
            self._told = now

    def __enter__(self) -> "Progress":
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.summary.seconds = time.monotonic() - self._start
        self._bar.stop()
