"""Stretching axis coherence (SAC): whether points move apart early along the axis of the true clip.

What the paper leaves open: the window is the first tenth of a clip, before the earliest published pull tears anything;
points are tracked from a grid inside the true object's mask in its first picture, in both clips alike; a true axis that
is undefined leaves a clip out, counted. c of a perfect clip is below 1: `sac_ceiling` is what a score can reach.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from fracgen.evaluation import axis, foreground
from fracgen.evaluation.axis import Axis
from fracgen.evaluation.clip import Clip, LackingError, Pair
from fracgen.evaluation.metric import Metric, Observation, mean
from fracgen.evaluation.queries import grid
from fracgen.evaluation.tracker import Tracker
from fracgen.layout import RGB
from fracsim import registry
from fracsim.records import Array
from fracsim.scene.knob import check, knob

SAME = "same"
TRACKERS = "fracgen.trackers"
NAN = float("nan")


@dataclass(kw_only=True)
class Settings:
    """How points are chosen and tracked, and when an axis counts."""

    tracker: str = knob("dis", "tracker of points, a module of fracgen.trackers", package=TRACKERS)
    options: dict[str, Any] = knob({}, "settings of the tracker, as {preset:fast}")
    gt_tracker: str = knob(SAME, "tracker of the true clip; same = that of the prediction, with its settings")
    gt_options: dict[str, Any] = knob({}, "settings of the true clip's tracker")
    t0: int = knob(0, "first frame of the window", least=0)
    window: float = knob(0.1, "length of the window as a part of the T - 1 steps of a clip; at least one step", least=0,
                         most=1)  # fmt: skip
    tau: float = knob(0.0025, "points that move by less than this part of the longer side, the mean removed, do not "
                      "count", least=0, most=1)  # fmt: skip
    k: int = knob(10, "fewest points for an axis", least=1)
    sigma: float = knob(15.0, "angle at which the score falls to 1/e", "deg", least=0, open="least")
    points: int = knob(60, "points of the grid along the longer side, on the object or not", least=2, most=1000)
    erode: float = knob(0.5, "points lie at least this far inside the object, as a part of their distance from each "
                        "other", least=0, most=60)  # fmt: skip

    def __post_init__(self) -> None:
        check(self, "metric.sac")


def build(settings: Settings) -> "Sac":
    """The metric; raises ValueError for trackers that are not known or cannot run."""
    tracker = tracker_of(settings.tracker, settings.options, "metric.sac.tracker", "metric.sac.options")
    if settings.gt_tracker == SAME:
        if settings.gt_options:
            raise ValueError(f"metric.sac.gt_options={settings.gt_options} has no tracker: name one in "
                             "metric.sac.gt_tracker, or leave it empty.")  # fmt: skip
        return Sac(settings, tracker, tracker)
    true = tracker_of(settings.gt_tracker, settings.gt_options, "metric.sac.gt_tracker", "metric.sac.gt_options")
    return Sac(settings, tracker, true)


def tracker_of(name: str, options: Mapping[str, Any], field: str, options_field: str) -> Tracker:
    """A tracker by name with its settings; the errors (ValueError) name `field` and `options_field`."""
    module = registry.load(TRACKERS, name, field)
    try:
        settings = module.Settings(**options)
    except TypeError:
        known = ", ".join(asdict(module.Settings()))
        raise ValueError(f"{options_field}={dict(options)} does not fit the tracker {name}: it has {known}.") from None
    tracker: Tracker = module.build(settings)
    return tracker


class Sac(Metric):
    """SAC, its ceiling, and what both rest on."""

    columns = ("sac", "sac_ceiling", "sac_theta", "sac_confidence", "sac_angle_pred", "sac_angle_gt", "sac_seen_pred",
               "sac_seen_gt", "sac_moving_pred", "sac_moving_gt", "sac_queries")  # fmt: skip
    """SAC; c of the true clip; angle between the axes [deg]; c of the prediction; both axes [deg]; parts of the points
    that are seen at both ends of the window, and that move enough; their number."""
    shown = columns
    higher = MappingProxyType({"sac": True, "sac_theta": False, "sac_undefined_pred": False})

    def __init__(self, settings: Settings, tracker: Tracker, gt_tracker: Tracker) -> None:
        super().__init__()
        self.settings, self.tracker, self.gt_tracker = settings, tracker, gt_tracker
        self.needs = () if {settings.tracker, settings.gt_tracker} & {"simulator", "tracks_file"} else (RGB,)

    def observe(self, pair: Pair) -> dict[str, Any]:
        """SAC of a pair; NaN where the true axis is undefined, 0 where only the predicted one is."""
        pred, gt = pair.pred, pair.true
        queries = self._queries(gt)
        true = self._axis(self.gt_tracker, gt, queries)
        guess = self._axis(self.tracker, pred, queries)
        theta = axis.between(guess.angle, true.angle)
        score = NAN
        if true.defined:
            score = axis.similarity(theta, self.settings.sigma) * guess.confidence if guess.defined else 0.0
        parts = {f"sac_{what}_{who}": _part(getattr(one, what), len(queries))
                 for who, one in (("pred", guess), ("gt", true)) for what in ("seen", "moving")}  # fmt: skip
        return {
            "sac": score, "sac_theta": theta, "sac_confidence": guess.confidence,
            "sac_ceiling": true.confidence if true.defined else NAN,
            "sac_angle_pred": guess.angle, "sac_angle_gt": true.angle, "sac_queries": len(queries), **parts,
        }  # fmt: skip

    def reduce(self, observed: Observation) -> dict[str, float]:
        """Means of what is defined, and how many axes are not."""
        lost = np.isnan(observed["sac_angle_gt"])
        means = {name: mean(observed[name]) for name in self.shown if "angle" not in name}
        return {
            **means, "sac_n": int((~lost).sum()), "sac_undefined_gt": int(lost.sum()),
            "sac_undefined_pred": int((np.isnan(observed["sac_angle_pred"]) & ~lost).sum()),
        }  # fmt: skip

    def about(self) -> dict[str, Any]:
        """All settings, and those of the trackers."""
        return {**asdict(self.settings), "tracker": self.tracker.about(), "gt_tracker": self.gt_tracker.about()}

    def _queries(self, gt: Clip) -> Array:
        size, s = max(gt.height, gt.width), self.settings
        if s.t0 + 1 >= gt.frames:
            raise LackingError(f"{gt.name} has {gt.frames} frames: SAC needs {s.t0 + 2} (metric.sac.t0={s.t0}).")
        stride = size / s.points
        return grid(foreground.mask(gt, s.t0), stride, s.erode * stride)

    def _axis(self, tracker: Tracker, clip: Clip, queries: Array) -> Axis:
        s = self.settings
        if not len(queries):
            return Axis(NAN, 0.0, 0, 0)
        t1 = min(s.t0 + max(1, round(s.window * (clip.frames - 1))), clip.frames - 1)
        tracks, seen = tracker(clip, queries, s.t0, t1)
        return axis.stretching(tracks[0], tracks[-1], seen[0] & seen[-1], s.tau * max(clip.height, clip.width), s.k)


def _part(count: int, of: int) -> float:
    return count / of if of else NAN
