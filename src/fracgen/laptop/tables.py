"""The tables of the report, from the scores of all runs."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from fracgen.evaluation import paper
from fracgen.evaluation.paper import Column
from fracgen.evaluation.table import ARROWS, METRICS, NONE, number
from fracgen.laptop import clips
from fracgen.laptop.study import OF_SETS, PRESETS, Study

COLUMNS = (*paper.ABLATED, *paper.BESIDE)
COMPARED = (("stage1", "stage2"), ("stage2", "stage3"), ("control", "stage3"))
"""Which row should be worse than which, as the paper says."""
NAMES = {"stage1": "stage 1", "stage2": "stage 2", "control": "stage 3, lambda_const = 0", "stage3": "stage 3"}
Scores = Mapping[str, Sequence[Mapping[str, float]]]
"""Results by the name of a variant, for each seed, by the title of a column; what is undefined is left out."""


def read(folder: str) -> dict[str, float]:
    """The results in a folder by the title of a column; raises ValueError when there are none."""
    path = Path(folder) / METRICS
    try:
        metrics = json.loads(path.read_text(encoding="utf-8"))["metrics"]
    except (OSError, ValueError, KeyError) as error:
        raise ValueError(f"{path} holds no results ({error}): run the steps before.") from None
    values = {c.title: metrics.get(c.metric, {}).get("results", {}).get(c.result, {}).get("value") for c in COLUMNS}
    return {title: value for title, value in values.items() if value is not None}


def scores(study: Study) -> Scores:
    """The results of all variants and seeds."""
    found: dict[str, list[dict[str, float]]] = {}
    for variant in study.variants:
        found.setdefault(variant.name, []).append(read(study.path("scores", variant.place)))
    return found


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


# The ablation


def ablation(found: Scores) -> str:
    """A row a result: each variant's mean over seeds, with the least and the most, and the paper's figures."""
    head = ["", *(NAMES[name] for name in NAMES), "paper: stages 1, 2, 3"]
    rows = []
    for k, column in enumerate(COLUMNS):
        theirs = [figures[k] for figures in paper.STAGES.values()] if k < len(paper.ABLATED) else [None] * 3
        cells = [_mean([seed[column.title] for seed in found[name] if column.title in seed]) for name in NAMES]
        rows.append([_titled(column), *cells, ", ".join(number(value) for value in theirs)])
    return markdown(head, rows)


def _titled(column: Column) -> str:
    return f"{column.title} {ARROWS[column.higher]}"


def _mean(values: Sequence[float]) -> str:
    """A mean, and the range of the seeds."""
    if not values:
        return NONE
    mean = number(sum(values) / len(values))
    return mean if len(values) == 1 else f"{mean} [{number(min(values))}, {number(max(values))}]"


def directions(found: Scores) -> str:
    """Whether the second variant of a pair is better than the first, seed by seed, and whether it is in the paper."""
    head = ["", *(f"{NAMES[a]} to {NAMES[b]}" for a, b in COMPARED)]
    rows = []
    for k, column in enumerate(COLUMNS):
        cells = [_direction(found, pair, column, k) for pair in COMPARED]
        if any(cell != NONE for cell in cells):
            rows.append([_titled(column), *cells])
    return markdown(head, rows)


def _direction(found: Scores, pair: tuple[str, str], column: Column, k: int) -> str:
    """One cell: how many seeds are better, and what the paper says."""
    title = column.title
    differences = [after[title] - before[title] for before, after in zip(found[pair[0]], found[pair[1]], strict=True)
                   if title in before and title in after]  # fmt: skip
    if not differences:
        return NONE
    better = sum((difference > 0) == column.higher for difference in differences)
    theirs = [paper.STAGES[NAMES[name].capitalize()][k] if k < len(paper.ABLATED) and name != "control" else None
              for name in pair]  # fmt: skip
    before, after = theirs
    told = "" if before is None or after is None else (
        "; paper: better" if (after > before) == column.higher else "; paper: worse")  # fmt: skip
    return f"better in {better} of {len(differences)}{told}"


# The generator against the simulator


def comparison(study: Study) -> str:
    """Seconds a clip and scores of solvers and samplers against the finest solver."""
    columns = [column for column in COLUMNS if column.metric not in OF_SETS]
    head = ["", "seconds a clip, one core", "n", *map(_titled, columns)]
    rows = []
    for kind, names in (("simulator", study.solvers), ("sampler", PRESETS)):
        for name in names:
            time, n = clips.seconds(study.path(kind, name))
            truth = kind == "simulator" and name == study.solvers[-1]
            found = {} if truth else read(study.path("scores", kind, name))
            cells = [number(found.get(column.title)) for column in columns]
            label = f"simulator, {name}{' (the truth)' if truth else ''}" if kind == "simulator" else (
                f"generator, sampler={name}")  # fmt: skip
            rows.append([label, number(time), str(n), *cells])
    return markdown(head, [*rows, *([*row, *[""] * (len(head) - len(row))] for row in planned())])


def planned() -> Iterator[list[str]]:
    """Label and seconds: what the full model would take on an H100, by `fracgen.plan`: nobody has measured it."""
    from fracgen.memory import planner
    from fracgen.memory.devices import device
    from fracgen.plan import PLAN, clips_of

    cfg = PLAN.compose("stage=3", "data.folder=none")
    clips_, _ = clips_of(cfg)
    one = planner.estimate(cfg, 3, clips_, device("h100"))
    size = f"{clips_.frames} frames of {clips_.width} x {clips_.height} px"
    for steps, passes in ((10, 1), (20, 1), (50, 2)):
        label = f"full model, {steps} steps, {passes} pass(es) a step, {size}, one H100 (planned, not measured)"
        yield [label, number(one.sampling_seconds(steps, passes))]


# Controlled pulls


def pulls(rows: Sequence[Mapping[str, Any]]) -> str:
    """Axis and frame of tearing of each controlled pull."""
    head = ["object", "pulled along", "tears at", "true axis", "generated axis", "true frame", "generated frame"]
    return markdown(head, [
        [row["object"], f"{row['axis']:g}°", f"{row['crit']:g}", f"{row['true_axis']:.0f}°", f"{row['made_axis']:.0f}°",
         _frame(row["true_torn"]), _frame(row["made_torn"])] for row in rows
    ])  # fmt: skip


def _frame(number_: int | None) -> str:
    return "whole" if number_ is None else str(number_)


def follows(rows: Sequence[Mapping[str, Any]]) -> str:
    """One sentence: how far generated axes are from those of the pull, and how often early thresholds tear earlier."""
    errors = [clips.between(row["made_axis"], row["axis"]) for row in rows]
    by_pull: dict[Any, list[int | None]] = {}
    for row in rows:  # sorted by crit: the early one first
        by_pull.setdefault((row["object"], row["axis"]), []).append(row["made_torn"])
    couples = [torn for torn in by_pull.values() if len(torn) == 2]
    earlier = sum(early is not None and (late is None or early < late) for early, late in couples)
    mean = number(sum(errors) / len(errors))
    return (f"The longest axis of the last generated picture is {mean}° from the axis of the pull in the mean "
            f"(45° is chance); early thresholds tear earlier in {earlier} of {len(couples)} pulls.")  # fmt: skip
