"""Mean squared errors of the physics maps, as they are shown in [0, 1]; lower is better.

By map M of flow, strain, stress, damage:

* `mse_M`: over all pixels with the background, 3 channels and frames; `mse` is the mean of the maps that are there.
* `mse_fg_M`: over the foreground alone, where a clip's alpha exceeds 1/2 or, without alpha, any of its maps 4/255; of
  both clips, as one set. `mse_fg` is the mean of the maps.
* `mse_scaled_M`, of strain and stress: with each clip's own scale, in units of the true clip's scale: an amplitude that
  `mse_M` cannot see, where both clips are normalised.
* `mse_flow_speed`: of the magnitude of flow, whatever its direction.
* `epe_flow`: the end-point error of flow on the foreground, as a part of each clip's own scale; `epe_flow_m_s` [m/s].

What cannot be told, as an error in m/s of a clip of unknown scale, is NaN and not in the mean; `maps` is how many maps
the means are of.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fracgen.evaluation.clip import ALPHA, Clip, LackingError, Pair
from fracgen.evaluation.foreground import COVERED
from fracgen.evaluation.metric import Metric, mean
from fracgen.layout import FLOW, MAPS, STRAIN, STRESS
from fracsim import codec
from fracsim.records import Array
from fracsim.scene.knob import check, knob

DEADBAND = 4 / 255
"""A map that is shown darker than this is background; a VAE does not paint black as exact zeros."""
SCALED = (STRAIN, STRESS)
NAN = float("nan")


@dataclass(kw_only=True)
class Settings:
    """Which maps are compared."""

    maps: list[str] = knob(list(MAPS), "maps that are compared, where both clips have them", choices=MAPS)

    def __post_init__(self) -> None:
        check(self, "metric.map_mse")
        if not self.maps or len(set(self.maps)) < len(self.maps):
            raise ValueError(f"metric.map_mse.maps={self.maps} is not allowed: name one or more of {', '.join(MAPS)}, "
                             "each once.")  # fmt: skip


class MapMse(Metric):
    """See above."""

    def __init__(self, maps: Sequence[str]) -> None:
        self.wanted = tuple(name for name in MAPS if name in maps)
        flow = ("mse_flow_speed", "epe_flow", "epe_flow_m_s") if FLOW in maps else ()
        shown = [f"{kind}{name}" for kind in ("mse_", "mse_fg_") for name in self.wanted]
        errors = ("mse", "mse_fg", *shown, *(f"mse_scaled_{name}" for name in SCALED if name in maps), *flow)
        self.higher = dict.fromkeys(errors, False)
        self.columns = self.shown = (*errors, "maps")
        super().__init__()

    def observe(self, pair: Pair) -> dict[str, float]:
        """All errors of a pair; raises LackingError when no map is wanted and in both clips."""
        there = [name for name in self.wanted if pair.pred.has(name) and pair.true.has(name)]
        if not there:
            raise LackingError(f"{pair.pred.name} and {pair.true.name} share no map of {', '.join(self.wanted)}")
        out = dict.fromkeys(self.columns, NAN)
        foreground = foregrounds(pair, there)
        for name in there:
            out |= _errors(pair, name, foreground)
        out |= {"mse": mean(np.array([out[f"mse_{name}"] for name in there])), "maps": float(len(there)),
                "mse_fg": mean(np.array([out[f"mse_fg_{name}"] for name in there]))}  # fmt: skip
        return out | (_flow(pair, foreground) if FLOW in there else {})

    def about(self) -> dict[str, Any]:
        """The maps that are wanted, and what foreground is."""
        return {"maps": list(self.wanted), "foreground": f"alpha > {COVERED}, else a map > {DEADBAND:.4f}; of either"}


def _errors(pair: Pair, name: str, foreground: Sequence[Array]) -> dict[str, float]:
    """The errors of one map, as it is shown, on the foreground and, where scales are known, scaled."""
    frames = list(zip(pair.pred.map(name), pair.true.map(name), strict=True))
    squares = [_squares(a, b) for a, b in frames]
    out = {f"mse_{name}": float(np.mean([s.mean() for s in squares])), f"mse_fg_{name}": _pooled(squares, foreground)}
    if name in SCALED and (ratio := _ratio(pair, name)):
        out[f"mse_scaled_{name}"] = float(np.mean([_squares(ratio * a, b).mean() for a, b in frames]))
    return out


def foregrounds(pair: Pair, names: Sequence[str]) -> list[Array]:
    """Where the object is in either clip, (H, W) bool for each frame."""
    both = zip(_object(pair.pred, names), _object(pair.true, names), strict=True)
    return [a | b for a, b in both]


def _object(clip: Clip, names: Sequence[str]) -> Iterator[Array]:
    """Where the object is in each frame of a clip, (H, W) bool."""
    if clip.has(ALPHA):
        yield from (frame > COVERED for frame in clip.alpha)
        return
    for frames in zip(*(clip.map(name) for name in names), strict=True):
        yield np.any([frame.max(axis=-1) > DEADBAND for frame in frames], axis=0)


def _squares(pred: Array, true: Array) -> Array:
    """Squared errors of the pixels of a frame (H, W, 1 or 3), means over channels, (H, W) float64."""
    return np.asarray(((np.asarray(pred, np.float64) - true) ** 2).mean(axis=-1))


def _pooled(squares: Sequence[Array], foreground: Sequence[Array]) -> float:
    """The mean of (H, W) over the foreground of all frames; NaN without any."""
    pixels = sum(int(f.sum()) for f in foreground)
    return float(sum(s[f].sum() for s, f in zip(squares, foreground, strict=True)) / pixels) if pixels else NAN


def _ratio(pair: Pair, name: str) -> float | None:
    """The predicted clip's scale of a map over the true one's; None where one is unknown."""
    scales = [clip.scales.get(name) for clip in (pair.pred, pair.true)]
    return scales[0] / scales[1] if scales[0] and scales[1] else None


def _flow(pair: Pair, foreground: Sequence[Array]) -> dict[str, float]:
    """Errors of the magnitude of flow, and end-point errors."""
    pred, true = pair.pred.map(FLOW), pair.true.map(FLOW)
    ends, physical, speed = [], [], []
    scales = [clip.scales.get(FLOW) for clip in (pair.pred, pair.true)]
    for a, b, where in zip(pred, true, foreground, strict=True):
        u, v = (codec.decode(frame[where], 1.0, 2) for frame in (a, b))
        ends.append(np.linalg.norm(u - v, axis=-1))
        if scales[0] and scales[1]:
            physical.append(np.linalg.norm(scales[0] * u - scales[1] * v, axis=-1))
        speed.append(np.mean((a.max(axis=-1) - b.max(axis=-1)) ** 2, dtype=np.float64))
    return {"mse_flow_speed": float(np.mean(speed)), "epe_flow": _mean(ends), "epe_flow_m_s": _mean(physical)}


def _mean(parts: Sequence[Array]) -> float:
    """The mean of all numbers of arrays (N,); NaN without any."""
    return mean(np.concatenate(parts)) if parts else NAN


def build(settings: Settings) -> MapMse:
    """The metric."""
    return MapMse(settings.maps)
