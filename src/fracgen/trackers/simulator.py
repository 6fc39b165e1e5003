"""The simulator's own tracks of surface particles, for simulated clips: what other trackers are measured against."""

from dataclasses import asdict, dataclass
from typing import Any

from fracgen.evaluation.clip import TRACKS, Clip
from fracgen.evaluation.tracker import Tracker
from fracgen.trackers._nearest import follow
from fracsim.records import Array
from fracsim.scene.knob import check, knob


@dataclass(kw_only=True)
class Settings:
    """Which particle stands for a query."""

    radius: float = knob(0.03, "a query follows the nearest particle within this part of the longer side", least=0,
                         open="least")  # fmt: skip

    def __post_init__(self) -> None:
        check(self, "tracker.simulator")


def build(settings: Settings) -> Tracker:
    """The tracker."""
    return Simulator(settings)


@dataclass(frozen=True)
class Simulator:
    """Moves each query as the nearest particle that is seen in the first frame."""

    settings: Settings

    def __call__(self, clip: Clip, queries: Array, t0: int, t1: int) -> tuple[Array, Array]:
        """Tracks (t1 - t0 + 1, N, 2) of queries (N, 2), and what is seen; raises LackingError without tracks."""
        tracks = clip.get(TRACKS)
        window = slice(t0, t1 + 1)
        return follow(tracks.xy[window], tracks.visible[window], queries,
                      self.settings.radius * max(clip.height, clip.width))  # fmt: skip

    def about(self) -> dict[str, Any]:
        """Settings."""
        return {"tracker": "simulator", **asdict(self.settings)}
