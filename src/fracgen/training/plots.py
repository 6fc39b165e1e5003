"""losses.png: how the losses of a run fell, drawn from its metrics.csv."""

import math
import os
from collections.abc import Mapping
from pathlib import Path

from fracgen.training.loggers import read

PICTURE = "losses.png"


def losses(folder: Path, metrics: str = "metrics.csv") -> Path | None:
    """Draw the losses in the table `metrics` of a run's `folder` against the optimiser step; None when it has none.

    Training to the left and validation to the right, where there was one; a curve a column, on a logarithmic axis.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # here, because it takes long to load
    from matplotlib.figure import Figure

    table = curves(read(folder / metrics)) if (folder / metrics).is_file() else {}
    if not table:
        return None
    figure = Figure(figsize=(10, 4), layout="constrained")
    FigureCanvasAgg(figure)
    halves = {title: {name.removeprefix(start): curve for name, curve in table.items() if name.startswith(start)}
              for title, start in (("training", "loss/"), ("validation", "val/loss/"))}  # fmt: skip
    shown = {title: found for title, found in halves.items() if found}
    for axes, (title, found) in zip(figure.subplots(1, len(shown), squeeze=False).flat, shown.items(), strict=True):
        for name, (steps, values) in found.items():
            axes.semilogy(steps, values, label=name, marker="." if len(steps) < 20 else "")
        axes.set(title=title, xlabel="optimiser step", ylabel="loss")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    part = folder / f".{PICTURE}"
    figure.savefig(part, format="png", dpi=110, metadata={"Software": None})
    os.replace(part, folder / PICTURE)
    return folder / PICTURE


def curves(rows: Mapping[int, Mapping[str, str]]) -> dict[str, tuple[list[int], list[float]]]:
    """Steps and values of each loss by its column: those of the streams and their sum, where finite and above 0."""
    names = dict.fromkeys(name for row in rows.values() for name in row if _is_loss(name))
    out = {}
    for name in names:
        pairs = [(step, float(row[name])) for step, row in sorted(rows.items()) if row.get(name)]
        good = [(step, value) for step, value in pairs if math.isfinite(value) and value > 0]
        if good:
            out[name] = ([step for step, _ in good], [value for _, value in good])
    return out


def _is_loss(name: str) -> bool:
    """A column of a loss, but not of one at a single noise level."""
    return name.startswith(("loss/", "val/loss/")) and not any(word in name for word in ("sigma", "const_"))
