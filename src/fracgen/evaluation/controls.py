"""What results are to be read against.

truth: each true clip against itself, the ceiling. vae: the true clip encoded and decoded, the ceiling of what works in
latents. static: the true clip standing still in its first frame. twins: the
same scene with other particles, the noise floor. axis: answers to SAC that do not know the axis.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from fracgen.config.evaluate import EvaluateConfig
from fracgen.evaluation.pairing import Couple, Paired, scene
from fracgen.evaluation.sources import Source
from fracsim.records import Array

ABOUT = {
    "truth": "each true clip against itself",
    "static": "the first frame of the true clip, repeated",
    "twins": "the same scenes with another seed",
    "vae": "each true clip through the VAE",
}
AXES = 180
"""Constant axes that are tried, one a degree."""


def couples(found: Paired, cfg: EvaluateConfig) -> dict[str, list[Couple]]:
    """The couples of each control that observes clips, evenly spread over all; only those that there are."""
    with_truth = [couple for couple in found.couples if couple.gt is not None]
    count = min(cfg.control_clips or len(with_truth), len(with_truth))
    chosen = [with_truth[k] for k in np.linspace(0, len(with_truth) - 1, count).round().astype(int)] if count else []
    makers: dict[str, Callable[[Couple], Couple | None]] = {
        "truth": _itself,
        "static": _standing,
        "twins": partial(_beside, twin=_twins(found.truths)),
        "vae": _coded if cfg.vae.path else lambda couple: None,
    }
    made = {name: [c for couple in chosen if (c := make(couple)) is not None]
            for name, make in makers.items() if name in cfg.controls}  # fmt: skip
    return {name: list({c.name: c for c in some}.values()) for name, some in made.items() if some}


def _itself(couple: Couple) -> Couple | None:
    return Couple(couple.gt, couple.gt, couple.groups, like=couple.pred) if couple.gt else None


def _standing(couple: Couple) -> Couple | None:
    return Couple(couple.gt, couple.gt, couple.groups, frozen=True, like=couple.pred) if couple.gt else None


def _coded(couple: Couple) -> Couple | None:
    return Couple(couple.gt, couple.gt, couple.groups, coded=True, like=couple.pred) if couple.gt else None


def _beside(couple: Couple, twin: Mapping[str, Source]) -> Couple | None:
    other = twin.get(couple.gt.name) if couple.gt else None
    return Couple(other, couple.gt, couple.groups, like=couple.pred) if other else None


def _twins(truths: Sequence[Source]) -> dict[str, Source]:
    """For each true clip one of the same scene, but with another seed, where there is one; by name."""
    by_scene: dict[Any, list[Source]] = {}
    for one in truths:
        if one.is_sample:
            by_scene.setdefault(scene(one), []).append(one)
    return {one.name: other for some in by_scene.values() for one in some
            for other in some if other.row["seed"] != one.row["seed"]}  # fmt: skip


def axis(angles: Array, sigma: float) -> dict[str, float]:
    """The best SAC that answers without knowledge of the axis can have, for true axes (n,) [deg] and width [deg].

    `uniform` draws each axis anew from all directions; `best_constant` is always the same axis, `best_axis` [deg]. They
    are upper bounds: the confidence of the axis, which is below 1, is left out. NaN among the angles are left out.
    """
    known = np.asarray(angles, np.float64)
    known = known[~np.isnan(known)]
    uniform = sigma * math.sqrt(math.pi) / 2 * math.erf(90 / sigma) / 90
    if not known.size:
        return {"uniform": uniform, "best_constant": math.nan, "best_axis": math.nan}
    trial = np.arange(AXES) * (180 / AXES)
    apart = np.abs(known[:, None] - trial) % 180
    scores = np.exp(-((np.minimum(apart, 180 - apart) / sigma) ** 2)).mean(axis=0)
    best = int(scores.argmax())
    return {"uniform": uniform, "best_constant": float(scores[best]), "best_axis": float(trial[best])}
