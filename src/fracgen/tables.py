"""python -m fracgen.tables [NAME=]DIR ...: the paper's tables beside ours.

Each DIR holds results of python -m fracgen.evaluate, in itself or below it. Rows of the stages are found by what the
results say about their run; NAME says whose row others are, as PhyCo-FT=baselines/phyco. An empty cell says why.
"""

import argparse
import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fracgen.evaluation import paper
from fracgen.evaluation.paper import Column
from fracgen.evaluation.table import ARROWS, METRICS, number, result

HEAD = ("row", "metric", "paper", "ours [95 %]", "n", "command")
NONE = "–"
Row = tuple[str, Sequence[float | None], Sequence[Column]]
"""A row of a table: its name, the paper's figures, and what they are of."""


@dataclass(frozen=True)
class Evaluation:
    """The results of one evaluation."""

    name: str
    """As it was given; empty = its row is that of its stage."""
    path: Path
    document: Mapping[str, Any]

    @property
    def stage(self) -> str:
        """The row of the ablation that it belongs to, or ""."""
        stage = self.document["run"].get("stage")
        return f"Stage {stage}" if stage is not None else ""

    def fits(self, row: str) -> bool:
        """Whether it belongs to a row of a table."""
        if self.name:
            return _plain(self.name) == _plain(row)
        return row == self.stage or (row == paper.FRACGEN and self.stage == "Stage 3")


def evaluations(arguments: Sequence[str]) -> list[Evaluation]:
    """The results that arguments [NAME=]DIR name; raises ValueError for a folder without."""
    found = []
    for argument in arguments:
        name, sign, path = argument.partition("=")
        name, path = (name, path) if sign and not Path(argument).exists() else ("", argument)
        files = _files(Path(path).expanduser())
        documents = [(file, document) for file in files if (document := _read(file)) is not None]
        if not documents:
            raise ValueError(f"{path} holds no results ({METRICS}): run python -m fracgen.evaluate first, or give its "
                             "output.folder.")  # fmt: skip
        found += [Evaluation(name, file.parent, document) for file, document in documents]
    return found


def _files(path: Path) -> list[Path]:
    """The results in a folder, or below it."""
    near = [path / METRICS, path / "evaluation" / METRICS]
    return [next(file for file in near if file.is_file())] if any(f.is_file() for f in near) else sorted(
        path.rglob(METRICS))  # fmt: skip


def _read(file: Path) -> Mapping[str, Any] | None:
    """Results; None for a file of something else."""
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        return document if {"run", "metrics", "missing", "command"} <= set(document) else None
    except (OSError, ValueError, TypeError):
        return None


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def tables(found: Sequence[Evaluation]) -> str:
    """The three tables in Markdown, and the commands."""
    keys = {str(one.path): chr(ord("A") + k) if k < 26 else f"A{k}" for k, one in enumerate(found)}
    ablation: list[Row] = [(row, figures, paper.ABLATED) for row, figures in paper.STAGES.items()]
    first: list[Row] = [(row, figures, paper.QUALITY) for row, figures in paper.TABLE_1.items()]
    baselines: list[Row] = [(row, figures, paper.QUALITY) for row, figures in paper.BASELINES.items()]
    known = [*paper.STAGES, *paper.TABLE_1, *paper.BASELINES]
    others = [one for one in found if not any(one.fits(row) for row in known)]
    for one in others:
        place, columns = (ablation, paper.ABLATED) if one.stage else (first, paper.QUALITY)
        place.append((one.name or str(one.path), [None] * len(columns), columns))
    parts = [
        _table("Table 1: the held-out test set", first, found, keys),
        _table("Ablation: the stages", ablation, found, keys),
        _table("Baselines, zero-shot and fine-tuned (-FT)", baselines, found, keys),
        _commands(found, keys),
    ]
    return "\n".join(parts)


def _table(title: str, rows: Sequence[Row], found: Sequence[Evaluation], keys: Mapping[str, str]) -> str:
    """A table with a line a figure."""
    lines = [_line(HEAD), _line(["---"] * len(HEAD))]
    for row, figures, columns in rows:
        mine = [one for one in found if one.fits(row) or (row == (one.name or str(one.path)))]
        printed = dict(zip(columns, figures, strict=True))
        beside = [column for column in paper.BESIDE if any(_has(one, column) for one in mine)]
        some = [_cells(column, printed.get(column), mine, keys) for column in (*columns, *beside)]
        lines += [
            _line((row if k == 0 else "", *cells)) for k, cells in enumerate(cell for part in some for cell in part)
        ]
    return "\n".join([f"## {title}", "", *lines, ""])


def _has(one: Evaluation, column: Column) -> bool:
    return column.metric in one.document["metrics"]


def _cells(
    column: Column, printed: float | None, mine: Sequence[Evaluation], keys: Mapping[str, str]
) -> Iterator[tuple[str, ...]]:
    """A line for each evaluation of a row, or one that says that there is none."""
    title = f"{column.title} {ARROWS[column.higher]}"
    figure = NONE if printed is None else f"{printed:g}"
    if not mine:
        yield title, figure, f"{NONE} (no results given)", "", ""
    for one in mine:
        entry = one.document["metrics"].get(column.metric)
        found = (entry or {}).get("results", {}).get(column.result)
        shown = result(found) if found and found["value"] is not None else f"{NONE} ({_why(one, column)})"
        yield title, figure, shown, str(entry["n"]) if entry else "", keys[str(one.path)]


def _why(one: Evaluation, column: Column) -> str:
    """Why there is no figure."""
    document = one.document
    if column.metric in document["missing"]:
        return str(document["missing"][column.metric])
    if column.metric not in document["metrics"]:
        return f"{column.metric} was not asked for: metric=[...,{column.metric}]"
    found = document["metrics"][column.metric]["results"]
    return "undefined for every clip" if column.result in found else f"{column.metric} gives no {column.result}"


def _commands(found: Sequence[Evaluation], keys: Mapping[str, str]) -> str:
    """The command of each evaluation, what its run was, and what the true maps give for R2_cons."""
    lines = [f"- {keys[str(one.path)]}: `{one.document['command']}`; {one.path}; {_run(one)}" for one in found]
    note = (
        f"The paper has {paper.CLIPS} clips of its own objects: figures of other clips and other n are not the same "
        f"quantity, FVD least of all. R2_cons of its true maps is {number(paper.R2_TRUTH)}."
    )
    return "\n".join(["## Commands", "", *lines, "", note])


def _run(one: Evaluation) -> str:
    """What a run was, in words."""
    run = one.document["run"]
    told = [f"{name} {run[name]}" for name in ("producer", "stage", "weights", "train_seed", "lambda_const") if
            name in run]  # fmt: skip
    return ", ".join(told) or "video files"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point; exit status 2 for a folder without results."""
    parser = argparse.ArgumentParser("python -m fracgen.tables", description=__doc__.partition("\n\n")[2],
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("results", nargs="+", metavar="[NAME=]DIR", help="folder with results")
    given = parser.parse_args(arguments)
    try:
        print(tables(evaluations(given.results)))
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
