"""Problems with known answers under the solver of a setting: a softening bar, and a manufactured solution."""

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
"""Cells along 2 m, and along a wavelength, for the default solver (150 cells along 2 m)."""


@dataclass(frozen=True)
class ProblemRun:
    """The cost and the errors of one run of a problem."""

    seconds: float
    """Processor time of the simulation, without compilation."""
    substeps: int
    errors: dict[str, float]
    """Errors relative to the exact answer."""


def scaled(solver: Solver, cells: int, multiple: int = 1) -> int:
    """`cells`, scaled by solver.cells over the default's, rounded to a multiple of `multiple`."""
    return multiple * round(cells * solver.cells / Solver().cells / multiple)


def softening_bar(solver: Solver) -> ProblemRun:
    """Errors of break stretch and peak load of the first bar of `fracsim.verify.problems.softening`."""
    law, E, nu, onset, crit, *_ = ROWS[0]
    stretch, peak, _ = softening(law, nu, onset, crit)
    solver = Setting(solver, solver.formulation).solver(scaled(solver, BAR_CELLS), solver.particles_per_axis)
    material, fracture = Material(law=law, E=E, nu=nu), Fracture(onset=onset, crit=crit)
    bar = pull.simulator(solver, BAR, material, fracture, 0.01, stretch + 0.15, 250)
    compile_kernels(bar.scene, bar.particles)
    start = time.process_time()
    with suppress(SimulationError):  # without damping the recoil may crush particles
        pull.until_parted(bar)
    seconds, report, body = time.process_time() - start, bar.report, bar.particles
    frame = report.break_frame if report.break_frame is not None else report.torn_frame
    parted = float("nan") if frame is None else report.history.nominal_stretch[frame]
    section = float(body.volume.sum()) / (float(np.ptp(body.X[:, 0])) + body.spacing)
    nominal = pull.over_gauge(bar, law, nu, stretch, peak)
    load = pull.at_peak(bar)[1] / section / E
    errors = {"break_stretch": abs(parted / nominal - 1), "peak_load": abs(load / peak - 1)}
    return ProblemRun(seconds, report.substeps, errors)


def manufactured(solver: Solver) -> ProblemRun:
    """Largest error of the displacement of the axis-aligned wave.

    The time is that of the kernels alone, without body forces and ghosts, set by the host before each substep.
    """
    setting = Setting(solver, solver.formulation)
    axis_aligned.error(setting, 4, per_axis=solver.particles_per_axis)  # compiles
    spent: list[float] = []
    cells = scaled(solver, WAVE_CELLS, 4)  # a multiple of 4, so that 1.5 particles an axis also fill the octant
    wrong = axis_aligned.error(setting, cells, per_axis=solver.particles_per_axis, spent=spent)
    return ProblemRun(sum(spent), len(spent), {"displacement": wrong})


PROBLEMS: dict[str, Callable[[Solver], ProblemRun]] = {
    "softening bar": softening_bar,
    "manufactured solution": manufactured,
}
