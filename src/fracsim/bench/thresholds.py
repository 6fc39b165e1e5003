"""Break stretch of a uniform bar against lambda_crit: the thresholds decide it in `total`, the grid in `updated`."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from fracsim import backend
from fracsim.bench.record import Row
from fracsim.scene.vocab import Backend, Fracture, Material, Solver
from fracsim.solve.march import SimulationError
from fracsim.verify.closed_form import softening
from fracsim.verify.pull import TensileBar, over_gauge, simulator, until_parted

CLASSES = {
    "low stretch": (Material(law="fixed_corotated", E=6e3, nu=0.25), 0.8, (1.6, 2.0, 2.3, 2.6, 3.0, 3.3)),
    "high stretch": (Material(law="neo_hookean", E=2e4, nu=0.45), 0.4, (1.6, 2.0, 2.4, 2.8, 3.0, 3.3, 3.6)),
}
"""Material, lambda_crit - lambda_onset, and lambda_crit of each bar."""
CELLS, SPEED = 50, 0.01
"""Cells along 2 m; speed of each grip over the wave speed."""
COLOURS = {"total": "#31688e", "updated": "#b5323c"}


def breaks(formulation: str, material: Material, fracture: Fracture) -> tuple[float, float, str]:
    """Nominal stretch at which the bar parts, that of the closed form, and the cause of parting."""
    solver = Solver(cells=CELLS, formulation=formulation, damping="none")
    sides = 4 * solver.h
    bar = TensileBar(gauge=16 * solver.h, width=sides, height=sides)
    pulled = simulator(solver, bar, material, fracture, SPEED, fracture.crit + 0.3, 300)
    stretch, load, _ = softening(material.law, material.nu, fracture.onset, fracture.crit)
    report, exact = pulled.report, over_gauge(pulled, material.law, material.nu, stretch, load)
    try:
        until_parted(pulled)
    except SimulationError:  # undamped recoil of a bar that parts between two frames
        return report.history.nominal_stretch[-1], exact, "crushed by its recoil"
    frame = report.break_frame if report.break_frame is not None else report.torn_frame
    at = float("nan") if frame is None else report.history.nominal_stretch[frame]
    return at, exact, "damage" if report.torn_frame is None else "torn by the grid"


def study(out: Path, quick: bool) -> Iterator[Row]:
    """Bars of both classes in both formulations; writes thresholds.png to `out`."""
    backend.start(Backend(threads=1))
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, (name, (material, width, crits)) in zip(figure.subplots(1, 2), CLASSES.items(), strict=True):
        chosen = crits[1:3] if quick else crits
        lines: dict[str, list[tuple[float, float, str]]] = {}
        for form in COLOURS:
            lines[form] = [breaks(form, material, Fracture(onset=max(c - width, 1.0), crit=c)) for c in chosen]
            for crit, (at, exact, how) in zip(chosen, lines[form], strict=True):
                yield Row(f"{name}, {form}", f"crit {crit}: breaks at a nominal stretch of ({how})", at, "1")
                yield Row(f"{name}, {form}", f"crit {crit}: over the closed form, {exact:.3f}", at / exact, "1")
        axes.plot(chosen, [exact for _, exact, _ in lines["total"]], color="#707070", label="closed form")
        for form, colour in COLOURS.items():
            for how, mark in (("damage", "o"), ("torn by the grid", "x"), ("crushed by its recoil", "^")):
                mine = [(c, at) for c, (at, _, why) in zip(chosen, lines[form], strict=True) if why == how]
                label = f"{form}, {how}"
                if mine:
                    axes.plot(*np.transpose(mine), mark, color=colour, label=label)
        axes.set(title=f"{name}: onset = crit - {width:g}", xlabel="lambda_crit",
                 ylabel="nominal stretch at which the bar parts")  # fmt: skip
        axes.grid(alpha=0.2)
        axes.legend(fontsize=8)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "thresholds.png", dpi=90, metadata={"Software": None})
