"""Simulated and generated clips side by side: frames, and when and along which axis they tear."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import fracsim.dataset
from fracsim.dataset import Clip
from fracsim.dataset.progress import shown
from fracsim.records import Array

FOREGROUND = 0.06
"""A pixel is of the object where its colour differs from white by this much, in [0, 1]."""
TORN = 0.5
"""A clip is torn from the frame on in which its damage is this part of what it is at the end."""
FAINT = 0.002
"""Mean damage of a picture below which a clip is whole; a crack of 2 x 20 px in 96 x 96 has 0.004."""


@dataclass(frozen=True, eq=False)
class Both:
    """A true clip and the generated one."""

    true: Clip
    made: Clip


def both(truth: str, made: str) -> list[Both]:
    """The clips in a folder of generated ones, each with its true one; raises ValueError where there are none."""
    known = {clip.row["id"]: clip for clip in fracsim.dataset.open(truth)}
    found = fracsim.dataset.open(made)
    pairs = [Both(known[of], clip) for clip in found if (of := clip.sample.meta["content"]["clip"]) in known]
    return sorted(pairs, key=lambda pair: (pair.true.row["object"], pair.true.row["id"]))


def seconds(folder: str) -> tuple[float, int]:
    """Mean time of a clip in a folder of samples [s], and their number."""
    times = [sum(clip.sample.meta["seconds"].values()) for clip in fracsim.dataset.open(folder)]
    return float(np.mean(times)), len(times)


def rgb(clip: Clip) -> Array:
    """Colour in [0, 1], (T, H, W, 3)."""
    return np.asarray(clip.read("rgb"), np.float64) / 255


def damage(clip: Clip) -> Array | None:
    """Damage in [0, 1], (T, H, W); None for a clip without."""
    if "damage" not in clip.sample.meta["maps"]:
        return None
    return np.asarray(clip.read("damage"), np.float64).reshape(clip.row["frames"], clip.row["height"], -1)


def torn(video: Array) -> int | None:
    """The first frame of a damage map (T, H, W) in which it is torn; None when it stays whole."""
    mean = video.mean(axis=(1, 2))
    if mean[-1] < FAINT:
        return None
    return int(np.argmax(mean >= TORN * mean[-1]))


def axis(picture: Array) -> float:
    """Direction in which the object in a picture (H, W, 3) in [0, 1] is longest, 0 to 180 deg, counter-clockwise from
    image right; NaN for an empty one. At the end of a pull that is the axis of the pull."""
    rows, columns = np.nonzero(np.abs(1 - picture).max(axis=-1) > FOREGROUND)
    if len(rows) < 2:
        return math.nan
    xx, xy, yy = np.cov(columns, -rows)[np.triu_indices(2)]
    return float(np.degrees(0.5 * np.arctan2(2 * xy, xx - yy)) % 180)


def between(first: float, second: float) -> float:
    """The angle between two axes, 0 to 90 [deg]."""
    return abs((first - second + 90) % 180 - 90)


def pulls(truth: str, made: str) -> list[dict[str, object]]:
    """Axis and frame of tearing of each controlled pull, true and generated, a row a clip."""
    pairs, rows = both(truth, made), []
    for pair in shown(pairs, len(pairs), "pulls"):
        row: dict[str, object] = {"object": pair.true.row["object"], "axis": float(pair.true.row["loading_axis_deg"]),
                                  "crit": float(pair.true.row["fracture_crit"])}  # fmt: skip
        for name, clip in (("true", pair.true), ("made", pair.made)):
            video = damage(clip)
            row[f"{name}_torn"] = None if video is None else torn(video)
            row[f"{name}_axis"] = axis(rgb(clip)[-1])
        rows.append(row)
    return sorted(rows, key=lambda row: (str(row["object"]), row["axis"], row["crit"]))


def exists(folder: str) -> bool:
    """Whether a folder holds a finished sample."""
    return any(Path(folder).glob("*/meta.json"))
