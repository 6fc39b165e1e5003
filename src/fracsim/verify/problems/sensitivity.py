"""Dependence of peak load, break stretch and work to break on h and dt, with and without a notch.

The damage law has no length scale: once damage localises, the work per section falls with h (Bazant 1976).
"""

from collections.abc import Iterator

from fracsim.scene.vocab import Fracture, Material
from fracsim.verify.closed_form import softening
from fracsim.verify.problem import Check, Setting, relative, reported
from fracsim.verify.pull import TensileBar, at_break, at_peak, simulator, until_parted

MATERIAL, FRACTURE = Material(law="fixed_corotated", E=2e3, nu=0.3), Fracture(onset=1.5, crit=2.3)
UNIFORM = TensileBar(gauge=0.64, width=0.16, height=0.16)
NOTCHED = TensileBar(gauge=0.64, width=0.24, height=0.16, notch=0.04, at=0.08)
"""The notch is 0.04 m deep on every grid: one cell of the coarse grid."""


def figures(setting: Setting, bar: TensileBar, cells: int, factor: float) -> tuple[float, float, float]:
    """Peak load / section / E, nominal stretch at the break, and work of the grips / section [J/m^2].

    `factor` multiplies the substep.
    """
    solver = setting.solver(cells)
    solver.safety *= factor
    if not isinstance(solver.dt, str):
        solver.dt *= factor
    sim = simulator(solver, bar, MATERIAL, FRACTURE, 0.02, 1.9, 200)
    until_parted(sim)
    return at_peak(sim)[1] / bar.section / MATERIAL.E, at_break(sim), sim.report.tally.grip_work / bar.section


def run(setting: Setting) -> Iterator[Check]:
    """Cells h and h / 2; substeps dt and dt / 2."""
    stretch, peak, _ = softening(MATERIAL.law, MATERIAL.nu, FRACTURE.onset, FRACTURE.crit)
    coarse = ((50, 1.0), (50, 0.5))
    for name, bar in (("uniform", UNIFORM), ("notched", NOTCHED)):
        for cells, factor in coarse if setting.quick else (*coarse, (100, 1.0)):
            load, broke, work = figures(setting, bar, cells, factor)
            size = f"h = {2 / cells:g} m, dt x {factor:g}"
            if bar.notch:
                yield reported(f"{name}: peak load / section / E, {size}", load)
                yield reported(f"{name}: break stretch, {size}", broke)
            else:
                yield relative(f"{name}: peak load / section / E, {size}", peak, load)
                yield relative(f"{name}: break stretch, {size}", stretch, broke)
            yield reported(f"{name}: work to break / section, {size}", work, "J/m^2")
