"""A scene of a sweep, what came of it, and the sum of many."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fracsim.run.outcome import Outcome
from fracsim.scene.vocab import Scene

MADE = ("complete", "suspect", "never breaks")
"""Statuses of a sample that was made now."""


@dataclass(frozen=True)
class Task:
    """A scene to be run, or the reason why what was asked for is none."""

    scene: Scene | None
    overrides: tuple[str, ...] = ()
    """What was given on the command line and by the sweep."""
    error: str = ""
    """Why there is no scene."""
    content: Mapping[str, Any] = field(default_factory=dict)
    """The configuration that is no scene."""


@dataclass(frozen=True)
class Attempt:
    """What came of a task."""

    task: Task
    name: str
    """Id of the sample; without a scene, a hash of the configuration."""
    outcome: Outcome
    wall: float
    """Wall-clock time [s]."""
    failure: str = ""
    """File of the failure, when it failed."""


@dataclass
class Summary:
    """Number of attempts by status, and how long they took together."""

    counts: Counter[str] = field(default_factory=Counter)
    wall: float = 0.0
    """Sum over the attempts [s]."""

    def add(self, attempt: Attempt) -> None:
        """Count an attempt."""
        self.counts[attempt.outcome.status] += 1
        self.wall += attempt.wall

    def __add__(self, other: "Summary") -> "Summary":
        return Summary(self.counts + other.counts, self.wall + other.wall)

    @property
    def made(self) -> int:
        """Samples that were made."""
        return sum(self.counts[status] for status in MADE)

    @property
    def failed(self) -> int:
        """Attempts that failed."""
        return self.counts["failed"]

    @property
    def interrupted(self) -> bool:
        """Whether it was stopped before its end."""
        return self.counts["interrupted"] > 0
