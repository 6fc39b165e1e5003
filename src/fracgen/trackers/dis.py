"""Chained DIS optical flow (Kroeger et al. 2016), checked forward and backward. Needs OpenCV; the default."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from fracgen.evaluation.clip import Clip
from fracgen.evaluation.tracker import Tracker
from fracgen.trackers._chain import chain, opencv
from fracsim.records import Array
from fracsim.scene.knob import check, knob

PRESETS = ("ultrafast", "fast", "medium")


@dataclass(kw_only=True)
class Settings:
    """How flow is computed and checked."""

    preset: str = knob("medium", "effort of the flow", choices=PRESETS)
    side: int = knob(256, "smaller pictures are enlarged to this longer side", "px", least=16, most=8192)
    tolerance: float = knob(0.002, "a point is lost when the flow there and back ends farther away than this part of "
                            "the longer side", least=0, open="least")  # fmt: skip

    def __post_init__(self) -> None:
        check(self, "tracker.dis")


def build(settings: Settings) -> Tracker:
    """The tracker; raises ValueError without OpenCV."""
    return Dis(settings, opencv("dis"))


@dataclass(frozen=True)
class Dis:
    """Adds up the flow between neighbouring frames along each point's path."""

    settings: Settings
    cv2: Any

    def __call__(self, clip: Clip, queries: Array, t0: int, t1: int) -> tuple[Array, Array]:
        """Tracks (t1 - t0 + 1, N, 2) of queries (N, 2), and what is seen."""
        preset = getattr(self.cv2, f"DISOPTICAL_FLOW_PRESET_{self.settings.preset.upper()}")
        flow = self.cv2.DISOpticalFlow_create(preset)

        def step(here: Array, there: Array, points: Array) -> tuple[Array, Array]:
            field = flow.calc(here, there, None)
            at = points.T[::-1]
            moved = [ndimage.map_coordinates(field[..., c], at, order=1, mode="nearest") for c in (0, 1)]
            return points + np.stack(moved, axis=1), np.ones(len(points), bool)

        return chain(clip, queries, (t0, t1), step, self.settings.side, self.settings.tolerance)

    def about(self) -> dict[str, Any]:
        """Settings and the version of OpenCV."""
        return {"tracker": "dis", **asdict(self.settings), "opencv": self.cv2.__version__}
