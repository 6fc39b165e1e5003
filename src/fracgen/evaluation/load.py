"""From a couple on disk to a Pair: frames that belong together, equal sizes, maps as the model sees them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fracgen.config.evaluate import EvaluateConfig
from fracgen.data import pictures
from fracgen.evaluation import video
from fracgen.evaluation.clip import ALPHA, TRACKS, Clip, Pair
from fracgen.evaluation.coded import coded
from fracgen.evaluation.pairing import Couple
from fracgen.evaluation.sizes import Shrink, common
from fracgen.evaluation.sources import Source
from fracgen.evaluation.times import Length, choose
from fracgen.layout import DAMAGE, RGB
from fracsim import codec, maps, registry, sample
from fracsim.records import Array
from fracsim.sample import Sample, Tracks, schema
from fracsim.sample.identity import FRACSIM


def pair(couple: Couple, cfg: EvaluateConfig) -> Pair:
    """The pair of a couple; nothing of a sample is decoded before a metric asks for it.

    Raises ValueError when the two do not go together or cannot be read.
    """
    pred = _Opened(couple.pred)
    gt = pred if couple.gt == couple.pred else None if couple.gt is None else _Opened(couple.gt)
    if couple.like is not None and gt is not None:
        return _control(couple, pred, gt, cfg)
    chosen = choose(pred.length, gt.length if gt else None, cfg)
    shrink = common(pred.size, gt.size if gt else pred.size, cfg.resize)
    shown = _clip(pred, chosen.pred, shrink[0], chosen.fps, pred.percentile(cfg))
    true = _clip(gt, chosen.gt, shrink[1], chosen.fps, pred.percentile(cfg)) if gt else None
    return Pair(shown, true, couple.groups)


def _control(couple: Couple, pred: "_Opened", gt: "_Opened", cfg: EvaluateConfig) -> Pair:
    """A pair of two true clips, in the frames and the size in which the clip `like` is compared with `gt`."""
    assert couple.like is not None
    like = _Opened(couple.like)
    chosen, shrink = choose(like.length, gt.length, cfg), common(like.size, gt.size, cfg.resize)[1]
    if (pred.size, pred.length.frames) != (gt.size, gt.length.frames):
        raise ValueError(f"{pred.source.name} has another size or length than {gt.source.name}")
    shown, true = (_clip(one, chosen.gt, shrink, chosen.fps, like.percentile(cfg)) for one in (pred, gt))
    if pred is gt:
        shown = true
    if couple.coded:
        shown = coded(true, cfg.vae)
    return Pair(_still(true) if couple.frozen else shown, true, couple.groups)


@dataclass(frozen=True, eq=False)
class _Opened:
    """A source whose size and length are known."""

    source: Source

    @cached_property
    def sample(self) -> Sample:
        """The sample; raises ValueError when it is not whole."""
        return sample.read(self.source.path)

    @cached_property
    def film(self) -> video.Film:
        """The decoded video file."""
        return video.read(self.source.path)

    @cached_property
    def size(self) -> tuple[int, int]:
        """Width and height [px]."""
        if self.source.is_sample:
            return tuple(self.sample.meta["size"])
        return self.film.rgb.shape[2], self.film.rgb.shape[1]

    @cached_property
    def length(self) -> Length:
        """Its frames and their rate."""
        if not self.source.is_sample:
            return Length(len(self.film.rgb), None, self.film.fps, None)
        meta = self.sample.meta
        return Length(self.sample.frames, float(meta["fps"]), None, self.encoding.get("frame_select"))

    @cached_property
    def encoding(self) -> Mapping[str, Any]:
        """How the training of a generated sample chose frames and scales; empty where nobody knows."""
        return self.sample.meta.get("encoding") or {} if self.source.is_sample else {}

    def percentile(self, cfg: EvaluateConfig) -> float:
        """The percentile by which the training of a generated sample scaled maps, or that of the configuration."""
        return float(self.encoding.get("percentile") or cfg.percentile)

    def raw(self, stream: str, numbers: Array) -> Array:
        """Frames of a stream as they lie on disk, [F, H, W, C]; raises ValueError."""
        if not self.source.is_sample:
            return self.film.rgb[numbers]
        first = int(numbers.min())
        return np.asarray(self.sample.read(stream, first, int(numbers.max()) + 1)[numbers - first])


def _clip(opened: _Opened, numbers: Array, shrink: Shrink, fps: float, percentile: float) -> Clip:
    """A clip of the frames `numbers`, (F,), of an opened source; `percentile` scales maps that were simulated."""
    name, scales = opened.source.name, _Scales()
    loads: dict[str, Callable[[], Any]] = {RGB: lambda: _colour(shrink(opened.raw(RGB, numbers)))}
    if opened.source.is_sample:
        meta = opened.sample.meta
        if not meta["rgb"]:
            del loads[RGB]
        for which in meta["maps"]:
            loads[which] = _Map(opened, which, numbers, shrink, percentile, scales)
            if _fixed(opened.sample, which) != 1 or which == DAMAGE:
                scales.names.append(which)
        if meta["alpha"]:
            loads[ALPHA] = lambda: shrink(opened.raw(ALPHA, numbers)[..., None])[..., 0]
        if schema.TRACKS in meta["files"]:
            loads[TRACKS] = lambda: _tracks(opened.sample.tracks, numbers, shrink)
    height, width = shrink.height, shrink.width
    clip = Clip(name, len(numbers), height, width, fps, loads, scales)
    scales.load = clip.get
    return clip


class _Scales(Mapping[str, float]):
    """Scales of maps that are known; one that has to be found from a map is found when it is asked for."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.found: dict[str, float] = {}
        self.load: Callable[[str], Any] = lambda name: None

    def __getitem__(self, name: str) -> float:
        if name not in self.names:
            raise KeyError(name)
        if name not in self.found:
            self.load(name)
        return self.found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True, eq=False)
class _Map:
    """Reads a map as it is shown, in [0, 1]."""

    opened: _Opened
    name: str
    numbers: Array
    shrink: Shrink
    percentile: float
    scales: _Scales = field(repr=False)

    def __call__(self) -> Array:
        """The video of the map, [F, h, w, 1 or 3]; raises ValueError when it is not finite."""
        values = self.shrink(self.opened.raw(self.name, self.numbers))
        if not np.isfinite(values).all():
            raise ValueError(f"{self.name} of {self.opened.source.name} has values that are not finite")
        fixed = _fixed(self.opened.sample, self.name)
        scale = codec.scale(values, self.percentile) if fixed is None else fixed
        self.scales.found[self.name] = scale
        return pictures.shown(values, scale)


def _fixed(clip: Sample, name: str) -> float | None:
    """The value of a map that is shown as 1, where that does not depend on the clip's own values."""
    if clip.producer != FRACSIM:
        return float(clip.meta["maps"][name]["scale"])
    return maps.load(name).SCALE if name in registry.names("fracsim.maps") else None


def _colour(frames: Array) -> Array:
    """Colour [F, h, w, 3] in whole numbers."""
    return frames if frames.dtype == np.uint8 else np.round(frames).astype(np.uint8)


def _tracks(tracks: Tracks, numbers: Array, shrink: Shrink) -> Tracks:
    """Tracks in the frames that are used, in the pixels of the pair."""
    xy = tracks.xy[numbers] * np.float32(1 / shrink.factor)
    return Tracks(xy, tracks.visible[numbers], tracks.particles)


def _still(clip: Clip) -> Clip:
    """A clip that stands still in its first frame."""

    def first(load: Callable[[], Any]) -> Callable[[], Any]:
        return lambda: _repeat(load())

    loads = {name: first(load) for name, load in clip.loads.items()}
    return Clip(clip.name, clip.frames, clip.height, clip.width, clip.fps, loads, clip.scales)


def _repeat(value: Any) -> Any:
    """The first frame of a stream [F, ...] or of tracks, as often as there are frames."""
    if isinstance(value, Tracks):
        return Tracks(_repeat(value.xy), _repeat(value.visible), value.particles)
    return np.repeat(value[:1], len(value), axis=0)
