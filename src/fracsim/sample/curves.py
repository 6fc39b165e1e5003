"""report.png: how the object was loaded, stretched and torn."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

History = Mapping[str, Sequence[float]]
"""Curves over frames: t [s], nominal_stretch, load [N], stretch_max, damaged and failed (fractions); over
substeps: dt_t and dt [s]. What is missing is left out."""

MARGINS = {"left": 0.08, "right": 0.985, "top": 0.95, "bottom": 0.08, "wspace": 0.2, "hspace": 0.3}
"""A layout that fits itself would draw everything twice."""
BLUE, ORANGE, RED, GREY = "#31688e", "#d9822b", "#b5323c", "#707070"


def plot(
    history: History, report: Mapping[str, Any], path: Path, thresholds: tuple[float, float] | None = None
) -> None:
    """Draw the four panels to `path`; report["break_frame"] is marked, `thresholds` are onset and crit stretch."""
    figure = Figure(figsize=(10, 7))
    figure.subplots_adjust(**MARGINS)
    FigureCanvasAgg(figure)
    load, stretch, damage, step = figure.subplots(2, 2).flat
    broken = report.get("break_frame")
    _load(load, history, broken)
    _stretch(stretch, history, thresholds)
    _damage(damage, history)
    _step(step, history)
    for axes in (stretch, damage, step):
        _mark(axes, history, broken)
    for axes in (load, stretch, damage, step):
        _tidy(axes)
    figure.savefig(path, dpi=110, metadata={"Software": None})


def _load(axes: Axes, history: History, broken: int | None) -> None:
    x, y = _curve(history, "nominal_stretch", "load")
    axes.plot(x, y, color=BLUE)
    if broken is not None and broken < len(x):
        axes.plot(x[broken], y[broken], "o", color=RED, label=f"breaks at nominal stretch {x[broken]:.2f}")
    if len(y):
        top = int(np.argmax(y))
        axes.plot(x[top], y[top], "^", color=BLUE, label=f"largest load {y[top]:.3g} N")
    axes.set(title="tension between the grips", xlabel="nominal stretch [1]", ylabel="load [N]")


def _stretch(axes: Axes, history: History, thresholds: tuple[float, float] | None) -> None:
    axes.plot(*_curve(history, "t", "stretch_max"), color=BLUE)
    for name, value in zip(("onset", "crit"), thresholds or (), strict=False):
        axes.axhline(value, color=GREY, linewidth=0.8, linestyle=":")
        axes.annotate(name, (1, value), xycoords=("axes fraction", "data"), xytext=(-3, 2),
                      textcoords="offset points", ha="right", fontsize=8, color=GREY)  # fmt: skip
    axes.set(title="largest principal stretch", xlabel="time [s]", ylabel="stretch [1]")


def _damage(axes: Axes, history: History) -> None:
    for name, colour in (("damaged", ORANGE), ("failed", RED)):
        t, fraction = _curve(history, "t", name)
        axes.plot(t, 100 * fraction, color=colour, label=name)
    axes.set(title="damaged and failed material", xlabel="time [s]", ylabel="share of particles [%]")
    axes.set_ylim(bottom=0)


def _step(axes: Axes, history: History) -> None:
    t, dt = _curve(history, "dt_t", "dt")
    axes.plot(t, 1e6 * dt, color=BLUE, linewidth=0.9)
    axes.set(title="substep", xlabel="time [s]", ylabel="dt [µs]")
    axes.set_ylim(bottom=0)


def _curve(history: History, x: str, y: str) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Two curves cut to the shorter one."""
    a, b = (np.asarray(history.get(name, ()), dtype=float) for name in (x, y))
    n = min(len(a), len(b))
    return a[:n], b[:n]


def _mark(axes: Axes, history: History, broken: int | None) -> None:
    t = history.get("t", ())
    if broken is not None and broken < len(t):
        axes.axvline(t[broken], color=RED, linewidth=0.8, linestyle="--", label=f"breaks at {t[broken]:.2f} s")


def _tidy(axes: Axes) -> None:
    curves = [line for line in axes.lines if line.get_transform() == axes.transData]
    if not any(len(np.asarray(line.get_xdata())) for line in curves):
        axes.text(0.5, 0.5, "not recorded", transform=axes.transAxes, ha="center", color=GREY)
    axes.grid(color="#e4e4e4", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.title.set_fontsize(11)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, fontsize=9)
