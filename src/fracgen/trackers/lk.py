"""Chained pyramidal Lucas-Kanade (Bouguet 2001), checked forward and backward. Needs OpenCV."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fracgen.evaluation.clip import Clip
from fracgen.evaluation.tracker import Tracker
from fracgen.trackers._chain import chain, opencv
from fracsim.records import Array
from fracsim.scene.knob import check, knob


@dataclass(kw_only=True)
class Settings:
    """How patches are matched and checked."""

    patch: int = knob(21, "side of the patch around a point in the (enlarged) picture", "px", least=5, most=101)
    levels: int = knob(3, "coarser pictures above the finest one", least=0, most=8)
    side: int = knob(256, "smaller pictures are enlarged to this longer side", "px", least=16, most=8192)
    tolerance: float = knob(0.002, "a point is lost when the step there and back ends farther away than this part of "
                            "the longer side", least=0, open="least")  # fmt: skip

    def __post_init__(self) -> None:
        check(self, "tracker.lk")


def build(settings: Settings) -> Tracker:
    """The tracker; raises ValueError without OpenCV."""
    return LucasKanade(settings, opencv("lk"))


@dataclass(frozen=True)
class LucasKanade:
    """Matches the patch around each point from frame to frame."""

    settings: Settings
    cv2: Any

    def __call__(self, clip: Clip, queries: Array, t0: int, t1: int) -> tuple[Array, Array]:
        """Tracks (t1 - t0 + 1, N, 2) of queries (N, 2), and what is seen."""
        patch, levels = (self.settings.patch,) * 2, self.settings.levels

        def step(here: Array, there: Array, points: Array) -> tuple[Array, Array]:
            if not len(points):
                return points, np.ones(0, bool)
            start = np.ascontiguousarray(points[:, None], np.float32)
            moved, found, _ = self.cv2.calcOpticalFlowPyrLK(here, there, start, None, winSize=patch, maxLevel=levels)
            return moved[:, 0].astype(np.float64), found[:, 0].astype(bool)

        return chain(clip, queries, (t0, t1), step, self.settings.side, self.settings.tolerance)

    def about(self) -> dict[str, Any]:
        """Settings and the version of OpenCV."""
        return {"tracker": "lk", **asdict(self.settings), "opencv": self.cv2.__version__}
