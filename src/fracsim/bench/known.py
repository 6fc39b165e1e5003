"""Problems with known answers under the solver of a setting: a bar that softens, and a manufactured solution."""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from fracsim.bench.scenes import compile_kernels
from fracsim.scene.vocab import Fracture, Material, Solver
from fracsim.solve.march import SimulationError
from fracsim.verify import pull
from fracsim.verify.closed_form import softening
from fracsim.verify.problem import Setting
from fracsim.verify.problems import axis_aligned
from fracsim.verify.problems.softening import BAR, ROWS

BAR_CELLS, WAVE_CELLS = 50, 24
"""Cells along 2 m, and along a wavelength, where the default has 150 along 2 m."""


@dataclass(frozen=True)
class Found:
    """What one run gave."""

    seconds: float
    """Processor time of the simulation, kernels compiled."""
    substeps: int
    errors: dict[str, float]
    """Relative, against the exact answer."""


def scaled(solver: Solver, cells: int, multiple: int = 1) -> int:
    """As many cells, a multiple, as this setting has where the default has `cells`."""
    return multiple * round(cells * solver.cells / Solver().cells / multiple)


def softening_bar(solver: Solver) -> Found:
    """Break stretch and peak load of the first row of the table of softening bars."""
    law, E, nu, onset, crit, *_ = ROWS[0]
    stretch, peak, _ = softening(law, nu, onset, crit)
    solver = Setting(solver, solver.formulation).solver(scaled(solver, BAR_CELLS), solver.particles_per_axis)
    material, fracture = Material(law=law, E=E, nu=nu), Fracture(onset=onset, crit=crit)
    bar = pull.simulator(solver, BAR, material, fracture, 0.01, stretch + 0.15, 250)
    compile_kernels(bar.scene, bar.particles)
    start = time.process_time()
    with suppress(SimulationError):  # what is not damped may be crushed by its recoil
        pull.until_parted(bar)
    seconds, report, body = time.process_time() - start, bar.report, bar.particles
    frame = report.break_frame if report.break_frame is not None else report.torn_frame
    parted = float("nan") if frame is None else report.history.nominal_stretch[frame]
    section = float(body.volume.sum()) / (float(np.ptp(body.X[:, 0])) + body.spacing)
    nominal = pull.over_gauge(bar, law, nu, stretch, peak)
    load = pull.at_peak(bar)[1] / section / E
    errors = {"break_stretch": abs(parted / nominal - 1), "peak_load": abs(load / peak - 1)}
    return Found(seconds, report.substeps, errors)


def manufactured(solver: Solver) -> Found:
    """Largest error of the displacement of the axis-aligned wave; the time is that of the kernels alone, without the
    body forces and ghosts that the host puts in before each substep."""
    setting = Setting(solver, solver.formulation)
    axis_aligned.error(setting, 4, per_axis=solver.particles_per_axis)  # compiles
    spent: list[float] = []
    cells = scaled(solver, WAVE_CELLS, 4)  # so that particles fill the octant at 1.5 an axis, too
    wrong = axis_aligned.error(setting, cells, per_axis=solver.particles_per_axis, spent=spent)
    return Found(sum(spent), len(spent), {"displacement": wrong})


PROBLEMS: dict[str, Callable[[Solver], Found]] = {
    "softening bar": softening_bar,
    "manufactured solution": manufactured,
}
