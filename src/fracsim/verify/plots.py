"""Plots of convergence: error against h or dt, with its slope."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fracsim.verify.problem import Check

STYLES = {"total": {"color": "C0", "marker": "o"}, "updated": {"color": "C1", "marker": "s", "fillstyle": "none"}}


def studies(checks: Sequence[Check]) -> dict[str, dict[tuple[str, str], list[Check]]]:
    """Checks of refinements, by problem, then by formulation and quantity (the name up to its last comma)."""
    out: dict[str, dict[tuple[str, str], list[Check]]] = defaultdict(lambda: defaultdict(list))
    for c in checks:
        if c.axis and c.error > 0:
            out[c.problem][c.quantity.rpartition(", ")[0], c.formulation].append(c)
    return {name: dict(lines) for name, lines in out.items()}


def slope(checks: Sequence[Check]) -> float:
    """Order of the error over a refinement, by least squares; NaN for fewer than two sizes."""
    h, e = np.array([c.at for c in checks]), np.array([c.error for c in checks])
    return float(np.polyfit(np.log(h), np.log(e), 1)[0]) if len(set(h)) > 1 else float("nan")


def draw(checks: Sequence[Check], folder: Path) -> list[Path]:
    """One PNG for each problem with a refinement; returns their paths."""
    from matplotlib.figure import Figure

    paths = []
    for name, lines in studies(checks).items():
        figure = Figure(figsize=(6.4, 4.0), layout="constrained")
        axes = figure.add_subplot()
        quantities = list(dict.fromkeys(quantity for quantity, _ in lines))
        for (quantity, form), line in lines.items():
            style = ("-", "--", ":", "-.")[quantities.index(quantity) % 4]
            line = sorted(line, key=lambda c: c.at)
            axes.loglog([c.at for c in line], [c.error for c in line], linestyle=style, **STYLES[form],
                        label=f"{quantity}, {form}: slope {slope(line):.2f}")  # fmt: skip
        (axis,) = {c.axis for line in lines.values() for c in line}
        axes.set(title=name.replace("_", " "), xlabel=f"{axis} [{'m' if axis == 'h' else 's'}]", ylabel="error")
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize="x-small", handlelength=4)
        paths.append(folder / f"{name}.png")
        figure.savefig(paths[-1], dpi=110)
    return paths
