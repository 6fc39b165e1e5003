"""What metrics see of a clip, from whatever it was read. T frames of H rows and W columns."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from fracgen.layout import RGB
from fracsim.records import Array

ALPHA, TRACKS = "alpha", "tracks"
"""Streams beside rgb and the maps."""


class LackingError(ValueError):
    """A clip has not what a metric needs; the text says what and why."""


@dataclass(frozen=True, eq=False)
class Clip:
    """A clip; what a metric asks for is decoded once, what none asks for never is."""

    name: str
    frames: int
    height: int
    width: int
    fps: float
    """Frames a second of simulated time [1/s]."""
    loads: Mapping[str, Callable[[], Any]]
    """How to read each stream that there is: rgb, alpha, tracks, and maps by name."""
    scales: Mapping[str, float] = field(default_factory=dict)
    """The value of a map, in its unit, that is shown as 1; absent where nobody knows it."""
    _read: dict[str, Any] = field(default_factory=dict, repr=False)

    def has(self, stream: str) -> bool:
        """Whether there is such a stream."""
        return stream in self.loads

    def get(self, stream: str) -> Any:
        """A stream; raises LackingError for one that there is not."""
        if stream not in self.loads:
            raise LackingError(f"{self.name} has no {stream}; it has {', '.join(self.loads) or 'nothing'}")
        if stream not in self._read:
            self._read[stream] = self.loads[stream]()
        return self._read[stream]

    @cached_property
    def rgb(self) -> Array:
        """Colour, (T, H, W, 3) uint8."""
        return self.get(RGB)  # type: ignore[no-any-return]

    @cached_property
    def alpha(self) -> Array:
        """Coverage by the object in [0, 1], (T, H, W) float32."""
        return self.get(ALPHA)  # type: ignore[no-any-return]

    def map(self, name: str) -> Array:
        """A map as it is shown, in [0, 1]: (T, H, W, 1) float32 for a scalar, (T, H, W, 3) for a vector's colours."""
        return self.get(name)  # type: ignore[no-any-return]


@dataclass(frozen=True, eq=False)
class Pair:
    """A predicted clip and the true one, of equal frames, height, width and rate."""

    pred: Clip
    gt: Clip | None
    """None where only what needs no truth is measured."""
    groups: Mapping[str, Any] = field(default_factory=dict)
    """What clips are grouped by: object, class, axis [deg] and others that are known."""

    @property
    def true(self) -> Clip:
        """The true clip; raises LackingError without one."""
        if self.gt is None:
            raise LackingError(f"{self.pred.name} has no true clip")
        return self.gt
