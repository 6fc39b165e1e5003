"""Which frame of the true clip belongs to which frame of the predicted one."""

from typing import NamedTuple

import numpy as np

from fracgen.config.evaluate import EvaluateConfig
from fracgen.data.pictures import select
from fracsim.records import Array


class Length(NamedTuple):
    """How long a clip is."""

    frames: int
    fps: float | None
    """Frames a second of simulated time [1/s]; None for a video file."""
    played: float | None
    """Frames a second at which a video file is played [1/s]."""
    frame_select: str | None
    """How the training of a generated sample chose frames of longer clips."""


class Chosen(NamedTuple):
    """Frames that belong together."""

    pred: Array
    """Numbers of the predicted frames, (F,)."""
    gt: Array
    """Numbers of the true frames, (F,)."""
    fps: float
    """Their rate in simulated time, where known, and else that at which the video is played [1/s]."""


def choose(pred: Length, gt: Length | None, cfg: EvaluateConfig) -> Chosen:
    """The frames that are compared: all predicted ones, and as many true ones.

    Raises ValueError naming what does not fit, and the way out.
    """
    every = np.arange(pred.frames)
    if gt is None:
        return Chosen(every, every, pred.fps or cfg.fps or pred.played or 1.0)
    rule = {"select": _select, "time": _time, "spread": _spread}[cfg.alignment]
    numbers = rule(pred, gt, cfg)
    span = int(numbers[-1] - numbers[0])
    step = span / (len(numbers) - 1) if len(numbers) > 1 and span else 1.0
    return Chosen(every, numbers, (gt.fps or cfg.fps or gt.played or 1.0) / step)


def _select(pred: Length, gt: Length, cfg: EvaluateConfig) -> Array:
    """The true frames that a training on clips of as many frames uses, (F,)."""
    rate = pred.fps or cfg.fps
    if rate and gt.fps and not np.isclose(rate, gt.fps, rtol=1e-3):
        raise ValueError(f"it has {rate:g} frames a second of simulated time, and its true clip {gt.fps:g}: "
                         "alignment=time compares the frames that are nearest in time")  # fmt: skip
    if pred.frames > gt.frames:
        raise ValueError(f"it has {pred.frames} frames, and its true clip only {gt.frames}: cut it, or set "
                         "alignment=spread")  # fmt: skip
    how = cfg.frame_select if cfg.frame_select != "auto" else pred.frame_select
    if pred.frames < gt.frames and how is None:
        if pred.fps is None or gt.fps is None:
            raise ValueError(f"it has {pred.frames} frames, and its true clip {gt.frames}: say by frame_select=head, "
                             "tail or linspace, or alignment=time or spread, which ones belong together")  # fmt: skip
        how = "head"
    return select(gt.frames, pred.frames, how or "head")


def _time(pred: Length, gt: Length, cfg: EvaluateConfig) -> Array:
    """The true frames nearest in time, (F,)."""
    simulated = pred.fps or cfg.fps
    ours, theirs = (simulated, gt.fps) if gt.fps else (simulated or pred.played, gt.played)
    if not ours or not theirs:
        raise ValueError("alignment=time needs the rate of the predicted video in simulated time: set fps")
    numbers: Array = np.floor(np.arange(pred.frames) * (theirs / ours) + 0.5).astype(int)
    if numbers[-1] >= gt.frames:
        raise ValueError(f"it lasts {(pred.frames - 1) / ours:.3g} s, and its true clip only "
                         f"{(gt.frames - 1) / theirs:.3g} s: cut it, or set alignment=spread")  # fmt: skip
    return numbers


def _spread(pred: Length, gt: Length, cfg: EvaluateConfig) -> Array:
    """True frames from the first to the last, (F,)."""
    return np.floor(np.linspace(0, gt.frames - 1, pred.frames) + 0.5).astype(int)
