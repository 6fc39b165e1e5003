"""How well one linear law explains stress and strain where nothing is damaged: R2_cons of the clips of a data set.

    python -m fracsim.dataset consistency DIR

On the pixels and frames with damage of at most 0.05, stress is fitted by a multiple of strain. R2_cons is the part of
the squared stress that the fit explains: the squared cosine of the two maps, 9/16 by chance for dense positive fields.
The paper reports 0.948 for its simulations. A generated clip is compared with the value of the simulations.
"""

import argparse
import math
from collections import defaultdict
from typing import Any

from fracsim.dataset.command import command
from fracsim.dataset.progress import shown
from fracsim.dataset.reader import Clip, open
from fracsim.records import Array

INTACT = 0.05
"""Largest damage of material that counts as intact (the paper's d_max)."""
BLOCK = 16
"""Frames read at a time."""
NEEDED = ("stress", "strain", "damage")


def sums(stress: Array, strain: Array, damage: Array) -> tuple[float, float, float]:
    """Sums of strain * stress, strain^2 and stress^2 over intact pixels, of arrays of any shape, in float64.

    Maps hold values times coverage; damage below INTACT of a pixel that is covered in part counts as intact, too.
    """
    intact = damage <= INTACT
    a, b = strain[intact].astype(float), stress[intact].astype(float)
    return float(a @ b), float(a @ a), float(b @ b)


def r2_cons(ab: float, aa: float, bb: float) -> float:
    """1 - sum (sigma - k eps)^2 / sum sigma^2 with the best k, from the sums; NaN where nothing intact is strained."""
    return ab * ab / (aa * bb) if aa > 0 and bb > 0 else math.nan


def of_clip(clip: Clip) -> float:
    """R2_cons of a clip that has the maps stress, strain and damage."""
    total = [0.0, 0.0, 0.0]
    for start in range(0, clip.row["frames"], BLOCK):
        stop = min(start + BLOCK, clip.row["frames"])
        maps = (clip.read(name, start, stop) for name in NEEDED)
        total = [t + s for t, s in zip(total, sums(*maps), strict=True)]
    return r2_cons(*total)


def add(subparsers: Any) -> None:
    """The command `consistency`."""
    command(subparsers, "consistency", "print R2_cons of stress and strain", __doc__, run)


def run(arguments: argparse.Namespace) -> int:
    """Print the mean over clips by object, by class and of all, and how many clips have none."""
    clips = open(arguments.folder)
    mapped = clips.filter(lambda row: all(row[f"{name}_file_name"] for name in NEEDED))
    groups: dict[str, list[float]] = defaultdict(list)
    for clip in shown(mapped, len(mapped), "reading maps"):
        value = of_clip(clip)
        for group in (clip.row["object"], clip.row["class"], "all"):
            groups[group].append(value)
    for group, values in sorted(groups.items(), key=lambda item: (item[0] == "all", item[0])):
        found = [v for v in values if not math.isnan(v)]
        mean = f"{sum(found) / len(found):.3f}" if found else "none"
        print(
            f"{group:<14} {mean:>6}  {len(found)} clips" + f", {len(values) - len(found)} undefined" * (found != values)
        )
    if len(mapped) < len(clips):
        print(f"{len(clips) - len(mapped)} clips lack one of the maps {', '.join(NEEDED)}")
    return 0
