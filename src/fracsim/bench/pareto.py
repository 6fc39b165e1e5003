"""Run time against error of solver settings, on problems with known answers and on scenes that tear.

The errors of scenes are relative to the converged reference.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from fracsim import backend
from fracsim.bench import known, scenes
from fracsim.bench.record import Row
from fracsim.bench.scenes import SCENES, SceneRun
from fracsim.scene.program import compose
from fracsim.scene.vocab import Backend

REFERENCE = "quality=reference"
PRESETS = {"preview": ("quality=preview", "camera.width=128", "camera.height=128"), "default": (),
           "paper": ("quality=paper",), "reference": (REFERENCE,)}  # fmt: skip
KNOBS = {
    "cells=75": ("solver.cells=75",),
    "cells=100": ("solver.cells=100",),
    "cells=120": ("solver.cells=120",),
    "particles_per_axis=1.5": ("solver.particles_per_axis=1.5",),
    "particles_per_axis=3": ("solver.particles_per_axis=3",),
    "safety=0.95": ("solver.safety=0.95",),
    "safety=0.6": ("solver.safety=0.6",),
    "safety=0.4": ("solver.safety=0.4",),
    "dt=1e-4": ("solver.dt=1e-4", "solver.dt_override=true"),
    "projection=0": ("solver.projection=0",),
    "projection=2": ("solver.projection=2",),
    "projection=every": ("solver.projection=every",),
    "projection=every, safety=0.4": ("solver.projection=every", "solver.safety=0.4"),
    "pressure=particle": ("solver.pressure=particle",),
    "precision=float64": ("solver.precision=float64",),
    "formulation=updated": ("solver=updated",),
    "updated, 4 particles": ("solver=updated", "solver.particles_per_axis=4"),
}
"""Changes of one field of the default preset at a time."""
GOOD = 0.01
"""Largest acceptable error of a cheaper setting."""
COUNTED = ("break_time", "break_stretch", "peak_load", "displacement")
"""Errors that enter `Point.error`; others are only reported."""


@dataclass(frozen=True)
class Point:
    """One setting on one scene or problem."""

    scene: str
    setting: str
    run: SceneRun | known.ProblemRun
    errors: dict[str, float]

    @property
    def error(self) -> float:
        """The largest of the counted errors; infinite if the object did not break."""
        counted = [error for name, error in self.errors.items() if name in COUNTED]
        return max(counted) if np.isfinite(counted).all() else float("inf")


def points(settings: dict[str, tuple[str, ...]], names: tuple[str, ...]) -> Iterator[Point]:
    """Run all settings on all problems and scenes, the reference of a scene first."""
    for name in names:
        yield from solved(name, settings) if name in known.PROBLEMS else torn(name, settings)


def solved(name: str, settings: dict[str, tuple[str, ...]]) -> Iterator[Point]:
    """A problem under all settings, with errors against its exact answer."""
    for setting, overrides in settings.items():
        found = known.PROBLEMS[name](compose(*overrides).solver)
        yield Point(name, setting, found, found.errors)


def torn(name: str, settings: dict[str, tuple[str, ...]]) -> Iterator[Point]:
    """A scene under all settings, with errors against its reference."""
    reference = scenes.run(scenes.scene(name, REFERENCE))
    for setting, overrides in settings.items():
        run = reference if overrides == (REFERENCE,) else scenes.run(scenes.scene(name, *overrides))
        yield Point(name, setting, run, run.against(reference))


def front(found: list[Point]) -> list[Point]:
    """The Pareto front: points that no other one beats in both time and error, fastest first."""
    best, out = float("inf"), []
    for p in sorted(found, key=lambda p: (p.run.seconds, p.error)):
        if p.error < best:
            best = p.error
            out.append(p)
    return out


def rows(found: list[Point]) -> Iterator[Row]:
    """Seconds, substeps and errors of each setting."""
    for p in found:
        yield Row(p.scene, f"{p.setting}: processor time", p.run.seconds, "s")
        yield Row(p.scene, f"{p.setting}: substeps", p.run.substeps, "substeps")
        for name, value in p.errors.items():
            yield Row(p.scene, f"{p.setting}: error of {name}", value, "1")


def tornado(found: list[Point]) -> list[tuple[str, str, float, float]]:
    """(scene, setting, time over that of the default, error) of each of KNOBS, fastest first."""
    out = []
    for name in {p.scene: None for p in found}:
        default = next(p for p in found if p.scene == name and p.setting == "default")
        knobs = [p for p in found if p.scene == name and p.setting in KNOBS]
        out += [(name, p.setting, p.run.seconds / default.run.seconds, p.error) for p in knobs]
    return sorted(out, key=lambda row: row[2])


def plot(found: list[Point], path: Path) -> None:
    """Error against time with the front, one panel for each scene. Settings are numbers, in red for presets.

    Errors below 0.01 % are drawn as 0.01 %.
    """
    names, settings = (list(dict.fromkeys(values)) for values in ([p.scene for p in found], [p.setting for p in found]))
    figure = Figure(figsize=(14, 4.5 * -(-len(names) // 2)), layout="constrained")
    FigureCanvasAgg(figure)
    for k, name in enumerate(names):
        axes = figure.add_subplot(-(-len(names) // 2), 2, k + 1)
        mine = [p for p in found if p.scene == name and np.isfinite(p.error)]
        line = front(mine)
        axes.plot([p.run.seconds for p in line], [max(100 * p.error, 1e-2) for p in line], color="#b0b0b0")
        for p in mine:
            number, colour = settings.index(p.setting) + 1, "#b5323c" if p.setting in PRESETS else "#31688e"
            size = 6 + 3 * len(str(number))
            axes.plot(p.run.seconds, max(100 * p.error, 1e-2), linestyle="", marker=f"${number}$", markersize=size,
                      color=colour, label=p.setting)  # fmt: skip
        axes.set(title=name, xscale="log", yscale="log", xlabel="processor time on one thread [s]",
                 ylabel="largest error [%]")  # fmt: skip
        axes.grid(alpha=0.2)
    handles = {
        label: handle for axes in figure.axes for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(handles.values(), handles.keys(), loc="outside right upper", fontsize=8)
    figure.savefig(path, dpi=100, metadata={"Software": None})


def study(out: Path, quick: bool) -> Iterator[Row]:
    """Run all settings on all scenes, write pareto.png to `out` and print the table of `tornado`."""
    settings = {"default": (), "preview": PRESETS["preview"]} if quick else {**PRESETS, **KNOBS}
    found: list[Point] = []
    backend.start(Backend(threads=1))
    names = ("manufactured solution", "low stretch") if quick else (*known.PROBLEMS, *SCENES)
    for p in points(settings, names):
        print(f"  {p.scene}, {p.setting}: {p.run.seconds:.2f} s, error {100 * p.error:.2f} %", flush=True)
        found.append(p)
    out.mkdir(parents=True, exist_ok=True)
    plot(found, out / "pareto.png")
    print(f"one knob at a time: time over that of the default, and its error (good below {100 * GOOD:g} %)")
    for name, setting, share, error in tornado(found):
        print(f"  {share:5.2f}  {100 * error:6.2f} %  {'good' if error <= GOOD else '    '}  {name}: {setting}")
    yield from rows(found)
