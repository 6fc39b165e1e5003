"""What is wrong with the clips that are scored: other scenes of the data set, or the true clip altered."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from fracgen.config.evaluate import EvaluateConfig
from fracgen.config.sensitivity import SensitivityConfig
from fracgen.evaluation import load
from fracgen.evaluation.clip import Clip, Pair
from fracgen.evaluation.pairing import SCENE, Couple, groups
from fracgen.evaluation.sources import Source
from fracgen.sensitivity import alter

ITSELF = "itself"
FIELDS = {
    "twin": ("seed",),
    "axis": ("loading_axis_deg",),
    "speed": ("loading_speed",),
    "thresholds": ("fracture_onset", "fracture_crit"),
    "stiffness": ("material_E",),
}
"""Cases of two scenes, and the columns of the table of a data set in which they differ, in no other."""
SAME = (*SCENE, "seed", "frames", "fps", "width", "height")
"""Columns by which two scenes are compared."""
ABOUT = {
    ITSELF: "the true clip",
    "twin": "the same scene with other particles: what differs is noise",
    "axis": "another axis of the pull",
    "speed": "another speed of the pull",
    "thresholds": "other thresholds of damage",
    "stiffness": "another Young's modulus",
    "blurred": "the true clip, blurred",
    "noisy": "the true clip with noise",
    "frozen": "the first frame of the true clip",
    "late": "the true clip, delayed",
    "other maps": "colour of the true clip, maps of another clip",
    "exchanged": "strain shown as stress, stress as damage, damage as strain",
}
"""All cases, in the order of the table."""


class Case(NamedTuple):
    """A clip that is scored."""

    name: str
    pair: Pair


def partner(one: Source, others: Sequence[Source], columns: Sequence[str]) -> Source | None:
    """The first of `others` whose scene differs from that of `one` in `columns` and in nothing else; None if none."""
    fixed = [name for name in SAME if name not in columns]

    def fits(other: Source) -> bool:
        differs = any(other.row[name] != one.row[name] for name in columns)
        return differs and all(other.row[name] == one.row[name] for name in fixed)

    return next((other for other in others if fits(other)), None)


def cases(number: int, sources: Sequence[Source], cfg: SensitivityConfig) -> Iterator[Case]:
    """All that is scored against the clip of this number; a case whose other clip is not in the data set is left out.

    Raises ValueError for a clip that cannot be read.
    """
    one, reading = sources[number], EvaluateConfig(frame_select="head")
    itself = load.pair(Couple(one, one, groups(one)), reading)
    true = itself.true
    yield Case(ITSELF, itself)
    for name, columns in FIELDS.items():
        other = partner(one, sources, columns)
        if other is not None:
            pred = load.pair(Couple(other, one, groups(one)), reading).pred
            yield Case(name, Pair(pred, true, itself.groups))
    for name, pred in altered(true, cfg):
        yield Case(name, Pair(pred, true, itself.groups))
    other = foreign(number, sources)
    if other is not None:
        maps = load.pair(Couple(other, one, groups(one)), reading).pred
        yield Case("other maps", Pair(alter.maps_of(true, maps), true, itself.groups))


def altered(true: Clip, cfg: SensitivityConfig) -> Iterator[tuple[str, Clip]]:
    """The true clip made wrong in each way that needs no other clip."""
    yield "blurred", alter.blurred(true, cfg.blur * true.width)
    yield "noisy", alter.noisy(true, cfg.noise, cfg.seed)
    yield "frozen", alter.frozen(true)
    yield "late", alter.late(true, max(1, round(cfg.shift * true.frames)))
    yield "exchanged", alter.exchanged(true)


def foreign(number: int, sources: Sequence[Source]) -> Source | None:
    """The clip in the middle of the rest of the list, of equal size and length, whose maps are taken; None if none."""
    size = ("frames", "fps", "width", "height")
    fitting = [other for other in [*sources[number + 1 :], *sources[:number]]
               if all(other.row[name] == sources[number].row[name] for name in size)]  # fmt: skip
    return fitting[len(fitting) // 2] if fitting else None
