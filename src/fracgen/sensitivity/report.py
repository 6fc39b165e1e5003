"""The tables: all results as CSV, and those that judge as Markdown, a row a result and a column a case."""

import csv
import io
import math
import os
from collections.abc import Sequence
from pathlib import Path

from fracgen.sensitivity.cases import ABOUT
from fracgen.sensitivity.study import Line

CSV, PAGE = "sensitivity.csv", "sensitivity.md"
COLUMNS = ("case", "metric", "result", "value", "n", "better")
UNDEFINED = "–"
ARROWS = {True: "↑", False: "↓"}
DIRECTIONS = {True: "higher", False: "lower", None: ""}


def write(found: Sequence[Line], folder: Path) -> tuple[Path, Path]:
    """Write both files at once each, and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in ((CSV, as_csv(found)), (PAGE, markdown(found))):
        part = folder / f".{name}.part"
        part.write_text(text, encoding="utf-8")
        os.replace(part, folder / name)
    return folder / CSV, folder / PAGE


def as_csv(found: Sequence[Line]) -> str:
    """All results, a row each; empty where undefined."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for line in found:
        value = f"{line.value:.6g}" if math.isfinite(line.value) else ""
        writer.writerow((line.case, line.metric, line.result, value, line.n, DIRECTIONS[line.higher]))
    return text.getvalue()


def markdown(found: Sequence[Line]) -> str:
    """The results that have a direction, and below them what the cases are."""
    there = [case for case in ABOUT if any(line.case == case for line in found)]
    values = {(line.result, line.case): line for line in found if line.higher is not None}
    arrows = {line.result: ARROWS[line.higher] for line in values.values() if line.higher is not None}
    rows = [[f"`{result}` {arrow}", *(_number(values.get((result, case))) for case in there)]
            for result, arrow in arrows.items()]  # fmt: skip
    counts = [str(max((line.n for line in found if line.case == case), default=0)) for case in there]
    table = [["", *there], ["---"] * (len(there) + 1), ["clips", *counts], *rows]
    about = [f"- **{case}**: {ABOUT[case]}" for case in there]
    return "\n".join([*(f"| {' | '.join(row)} |" for row in table), "", *about]) + "\n"


def _number(line: Line | None) -> str:
    """A value for people."""
    return f"{line.value:.3g}" if line is not None and math.isfinite(line.value) else UNDEFINED
