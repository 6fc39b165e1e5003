"""Pictures of the results: bars by class and object with their intervals, SAC by axis, and damage over time."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fracgen.evaluation.summary import Rows
from fracgen.evaluation.table import label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ACROSS = 4
"""Panels in a row."""
CURVES = 6
"""Clips whose damage is drawn."""


def draw(folder: Path, document: Mapping[str, Any], rows: Mapping[str, Rows]) -> list[Path]:
    """Draw what there is into a folder, and return the files."""
    made = [_bars(folder, document, group) for group in document["settings"]["by"]]
    return [path for path in [*made, _damage(folder, rows.get("dpa") or ())] if path is not None]


def _bars(folder: Path, document: Mapping[str, Any], group: str) -> Path | None:
    """A panel a metric, with a bar for all clips and for each value of a group."""
    panels = [
        (label(metric, column), entry, column)
        for metric, entry in document["metrics"].items()
        if (column := headline(metric, entry)) and entry["by"].get(group)
    ]
    if not panels:
        return None
    figure = _figure(len(panels))
    for axes, (title, entry, column) in zip(figure.axes, panels, strict=True):
        found = {"all": entry, **entry["by"][group]}
        _panel(axes, {name: one["results"].get(column) or {} for name, one in found.items()})
        axes.set_title(f"{title} {'↑' if entry['higher'][column] else '↓'}", fontsize=9)
    return _save(figure, folder / f"by_{group}.png")


def headline(metric: str, entry: Mapping[str, Any]) -> str:
    """The result that stands for a metric: the one of its name, as mse of map_mse, or the first; "" without any."""
    defined = [column for column, found in entry["results"].items()
               if column in entry["higher"] and found["value"] is not None]  # fmt: skip
    return next((column for column in defined if metric.endswith(column)), defined[0] if defined else "")


def _panel(axes: "Axes", results: Mapping[str, Mapping[str, Any]]) -> None:
    """Bars of results with their intervals."""
    values = np.array([np.nan if r.get("value") is None else r["value"] for r in results.values()], float)
    ends = np.array([[np.nan, np.nan] if r.get("low") is None else [r["low"], r["high"]] for r in results.values()])
    place = np.arange(len(values))
    axes.bar(place, np.nan_to_num(values), color=["0.35", *["0.7"] * (len(values) - 1)])
    axes.vlines(place, ends[:, 0], ends[:, 1], color="black", linewidth=1.2)
    axes.set_xticks(place, list(results), rotation=60, ha="right", fontsize=7)
    axes.tick_params(axis="y", labelsize=7)


def _damage(folder: Path, rows: Rows) -> Path | None:
    """Damage over time of a few clips, predicted and true, where DPA keeps its curves."""
    chosen = [rows[k] for k in np.linspace(0, len(rows) - 1, min(CURVES, len(rows))).round().astype(int)]
    chosen = [(couple, seen) for couple, seen in chosen if {"dpa_curve_pred", "dpa_curve_gt"} <= set(seen)]
    if not chosen:
        return None
    figure = _figure(len(chosen), across=3)
    for axes, (couple, seen) in zip(figure.axes, chosen, strict=True):
        for name, style, title in (("dpa_curve_gt", "0.6", "true"), ("dpa_curve_pred", "C3", "predicted")):
            curve = np.asarray(seen[name], float)
            axes.plot(np.linspace(0, 1, len(curve)), curve, color=style, linewidth=4 if title == "true" else 1.5,
                      label=title)  # fmt: skip
        axes.set(title=_title(couple.name, couple.groups), xlabel="part of the clip", ylabel="damage a(t)")
        axes.set_ylim(0, max(1e-3, axes.get_ylim()[1]))
        axes.title.set_fontsize(8)
        axes.grid(alpha=0.3)
    figure.axes[0].legend(fontsize=7)
    return _save(figure, folder / "damage.png")


def _title(name: str, groups: Mapping[str, Any]) -> str:
    """What a clip is called in a picture."""
    return " ".join([str(groups.get("object", "")), name]).strip()


def _figure(panels: int, across: int = ACROSS) -> "Figure":
    """A figure of as many panels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # here, because it takes long to load
    from matplotlib.figure import Figure

    columns = min(panels, across)
    lines = -(-panels // columns)
    figure = Figure(figsize=(3.0 * columns, 2.6 * lines), layout="constrained")
    FigureCanvasAgg(figure)
    for k in range(panels):
        figure.add_subplot(lines, columns, k + 1)
    return figure


def _save(figure: "Figure", path: Path) -> Path:
    """Write a picture at once."""
    part = path.with_name(f".{path.name}.part")
    figure.savefig(part, format="png", dpi=110, metadata={"Software": None})
    os.replace(part, path)
    return path


def files(folder: Path) -> Sequence[Path]:
    """The pictures in a folder of results."""
    return sorted(folder.glob("*.png"))
