"""Which predicted clip belongs to which true one, and how clips are grouped."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fracgen.config.evaluate import EvaluateConfig
from fracgen.evaluation import sources
from fracgen.evaluation.sources import Fault, Source
from fracsim.dataset.table import FIELDS, column_of

COLUMNS = {"class": "class", "object": "object", "split": "split", "axis": "loading_axis_deg", "speed": "loading_speed",
           "offset": "loading_offset", "E": "material_E", "nu": "material_nu", "onset": "fracture_onset",
           "crit": "fracture_crit"}  # fmt: skip
"""Groups, and the columns of the table of a data set that they come from."""
SCENE = ("object", *(column_of(name) for name in FIELDS))
"""Columns that tell one pull from another, whatever it was simulated with."""


@dataclass(frozen=True)
class Couple:
    """A predicted clip and the true one, not opened."""

    pred: Source
    gt: Source | None
    groups: Mapping[str, Any] = field(default_factory=dict)
    frozen: bool = False
    """Whether the predicted clip stands still: its first frame, repeated."""
    coded: bool = False
    """Whether the predicted clip goes through the VAE."""
    like: Source | None = None
    """A clip whose frames and size both clips take; None = those of the predicted one."""

    @property
    def name(self) -> str:
        """What the couple is called."""
        return self.pred.name


@dataclass(frozen=True)
class Paired:
    """What is to be scored."""

    couples: list[Couple]
    faults: list[Fault]
    alone: int = 0
    """True clips without a predicted one."""
    truths: Sequence[Source] = ()
    """All true clips."""


def pairs(cfg: EvaluateConfig) -> Paired:
    """What a configuration asks to be scored; raises ValueError when there is nothing."""
    if not cfg.pred:
        raise ValueError("pred= is empty: give a folder of samples or of videos, or a CSV file with columns pred, gt.")
    path = Path(cfg.pred).expanduser()
    if path.is_file() and path.suffix.lower() in (".csv", ".tsv"):
        if cfg.gt:
            raise ValueError(f"gt={cfg.gt} cannot be used with pred={cfg.pred}, whose column gt names the true clips.")
        found = _table(path)
    else:
        found = _folders(cfg)
    if not found.couples:
        why = "; ".join(f"{fault.clip}: {fault.reason}" for fault in found.faults[:3])
        raise ValueError(f"pred={cfg.pred}: no clip can be scored ({why}).")
    return Paired(found.couples[: cfg.limit or None], found.faults, found.alone, found.truths)


def _folders(cfg: EvaluateConfig) -> Paired:
    """The clips of two folders, or of one."""
    pred = sources.folder(cfg.pred, "pred", cfg.suspect)
    if not cfg.gt:
        return Paired([Couple(one, None, groups(one)) for one in pred.sources], pred.faults)
    gt = sources.folder(cfg.gt, "gt", cfg.suspect)
    match, couples, faults = _Match(gt.sources), [], [*pred.faults, *_of_truth(gt.faults)]
    for one in pred.sources:
        there = match(one)
        if len(there) == 1:
            couples.append(Couple(one, there[0], {**groups(one), **groups(there[0])}))
        else:
            many = f"several clips of gt={cfg.gt} fit: {', '.join(s.name for s in there[:3])}"
            faults.append(Fault(one.name, many if there else f"gt={cfg.gt} has no clip for it"))
    used = {couple.gt.name for couple in couples if couple.gt}
    return Paired(couples, faults, sum(one.name not in used for one in gt.sources), gt.sources)


def _of_truth(faults: Iterable[Fault]) -> list[Fault]:
    return [Fault(fault.clip, f"the true clip: {fault.reason}") for fault in faults]


class _Match:
    """Finds the true clip of a predicted one: by the id that a generated sample names, by name, or by its scene."""

    def __init__(self, truths: Sequence[Source]) -> None:
        self._by_name = {one.name: one for one in truths}
        self._by_scene: dict[Any, list[Source]] = {}
        for one in truths:
            if one.is_sample:
                self._by_scene.setdefault((scene(one), one.row["seed"]), []).append(one)

    def __call__(self, pred: Source) -> list[Source]:
        """The true clips that fit."""
        if pred.of:
            return [self._by_name[pred.of]] if pred.of in self._by_name else []
        if pred.name in self._by_name:
            return [self._by_name[pred.name]]
        return self._by_scene.get((scene(pred), pred.row["seed"]), []) if pred.is_sample else []


def scene(source: Source) -> tuple[str, ...]:
    """What tells the pull of a sample from others, whatever solver, camera or seed it was simulated with."""
    return tuple(repr(source.row[name]) for name in SCENE)


def groups(source: Source) -> dict[str, Any]:
    """What a sample is grouped by; empty for a video."""
    known = {name: source.row.get(column) for name, column in COLUMNS.items()}
    return {name: value for name, value in known.items() if value is not None}


def _table(path: Path) -> Paired:
    """The rows of a CSV file, whose paths are relative to it; further columns are groups."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = list(csv.DictReader(file, delimiter="\t" if path.suffix.lower() == ".tsv" else ","))
    if not rows or "pred" not in rows[0]:
        raise ValueError(f"pred={path} has no rows with a column pred: give a CSV file with columns pred and gt, and "
                         "if you like others, as object, by which results are grouped.")  # fmt: skip
    couples, faults, seen = [], [], set()
    for row in rows:
        given = {key: value for key, value in row.items() if key and value}
        try:
            couple = _row(path.parent, given)
            if couple.name in seen:
                raise ValueError("two rows have a predicted clip of this name")
            seen.add(couple.name)
            couples.append(couple)
        except (ValueError, KeyError, TypeError, OSError) as error:
            faults.append(Fault(given.get("pred", "(empty)"), str(error)))
    return Paired(couples, faults, truths=[c.gt for c in couples if c.gt])


def _row(folder: Path, row: Mapping[str, str]) -> Couple:
    """A row of a CSV file; raises ValueError for a path where there is no clip."""
    pred = sources.single(folder / Path(row["pred"]).expanduser())
    gt = sources.single(folder / Path(row["gt"]).expanduser()) if row.get("gt") else None
    more = {name: _number(value) for name, value in row.items() if name not in ("pred", "gt")}
    known = {**groups(pred), **(groups(gt) if gt else {}), **more}
    if not pred.is_sample:  # videos in several folders may have one stem
        pred = Source(Path(row["pred"]).with_suffix("").as_posix(), pred.path, pred.sha256)
    return Couple(pred, gt, known)


def _number(text: str) -> Any:
    """A number where a text is one."""
    try:
        return float(text)
    except ValueError:
        return text
