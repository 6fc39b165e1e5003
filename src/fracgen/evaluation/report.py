"""Writes what an evaluation found: metrics.json, per_clip.csv, table.md, table.tex; each at once or not at all."""

import csv
import io
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fracgen.evaluation import table
from fracgen.evaluation.metric import Metric
from fracgen.evaluation.summary import Rows, shown
from fracgen.evaluation.table import METRICS, label
from fracsim.sample.schema import plain

PER_CLIP, MARKDOWN, TEX = "per_clip.csv", "table.md", "table.tex"


def write(folder: Path, document: Mapping[str, Any], rows: Mapping[str, Rows], metrics: Mapping[str, Metric]) -> None:
    """Write all files; metrics.json last, so that it stands for the others."""
    save(folder / PER_CLIP, per_clip(rows, metrics))
    save(folder / MARKDOWN, table.markdown(document))
    save(folder / TEX, table.tex(document))
    save(folder / METRICS, json.dumps(plain(document), indent=1, ensure_ascii=False) + "\n")


def save(path: Path, text: str) -> None:
    """Write a file at once."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, path)


def clips(rows: Mapping[str, Rows], metrics: Mapping[str, Metric]) -> list[dict[str, str]]:
    """A row a clip: its names, its groups, and every single number that was observed; "" where it is undefined."""
    found: dict[str, dict[str, str]] = {}
    for name, some in rows.items():
        for couple, observation in some:
            start = {"clip": couple.name, "gt": couple.gt.name if couple.gt else "",
                     **{group: shown(value) for group, value in couple.groups.items()}}  # fmt: skip
            row = found.setdefault(couple.name, start)
            for column in metrics[name].shown:
                value = float(np.asarray(observation[column]).reshape(-1)[0])
                row[label(name, column)] = "" if np.isnan(value) else f"{value:.9g}"
    return [found[name] for name in sorted(found)]


def per_clip(rows: Mapping[str, Rows], metrics: Mapping[str, Metric]) -> str:
    """`clips` as CSV."""
    every = clips(rows, metrics)
    groups = list(dict.fromkeys(g for some in rows.values() for couple, _ in some for g in couple.groups))
    results = [label(name, column) for name in rows for column in metrics[name].shown]
    out = io.StringIO()
    writer = csv.DictWriter(out, ["clip", "gt", *groups, *results], restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(every)
    return out.getvalue()
