"""How the work to part a notched bar depends on the cells, with and without `fracture.length`."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from fracsim import backend
from fracsim.bench.record import Row
from fracsim.simulate import Simulator
from fracsim.verify.stage import lattice, particles
from fracsim.vocab import Backend, Capture, Fracture, Loading, Material, Scene, Solver

COARSE = 50
"""Cells along 2 m of the coarsest bar."""
H = 2 / COARSE
THRESHOLDS = {"low stretch": ("fixed_corotated", 0.3, Fracture(onset=1.5, crit=2.3), 0.1),
              "high stretch": ("neo_hookean", 0.45, Fracture(onset=2.6, crit=3.0), 0.3)}  # fmt: skip
"""Law, Poisson's ratio, thresholds, and speed of each grip [m/s] at E = 2e3 Pa."""
SHIFTS = (0.1, 0.6, 1.1, 1.6)
"""Places of the notch [particle spacings], all that differ within a cell: the width of the band depends on it."""


def parting(law: str, nu: float, fracture: Fracture, speed: float, cells: int, shift: float) -> tuple[float, float]:
    """Energy taken by damage over the section of the notch [J/m^2], and nominal stretch at the break."""
    solver = Solver(cells=cells, damping="none")
    gap = solver.spacing
    X = lattice((20 * H, 6 * H, 4 * gap), gap)
    notch = np.abs(X[:, 0] - 1 - 3 * H - shift * gap) < H
    X = X[~(notch & (np.abs(X[:, 1] - 1) > 1.5 * H))]
    duration = (fracture.onset - 1) * 1.2 * 16 * H / (2 * speed)
    scene = Scene(material=Material(law=law, E=2e3, nu=nu), fracture=fracture, solver=solver,
                  loading=Loading(offset=9 * H, thickness=2 * H, speed=speed, grips="sliding"),
                  capture=Capture(frames=150, fps=149 / duration), backend=Backend(threads=1))  # fmt: skip
    simulator = Simulator(scene, particles(X, gap))
    left = 3  # frames after the break in which what hangs on still tears
    for _ in simulator.frames():
        left -= simulator.report.parted
        if not left:
            break
    frame = simulator.report.break_frame
    at = float("nan") if frame is None else simulator.report.history.nominal_stretch[frame]
    return simulator.report.energy()["damage"] / (3 * H * 4 * gap), at


def study(out: Path, quick: bool) -> Iterator[Row]:
    """h, h / 2 and h / 4, thresholds as they are and belonging to the coarsest cells."""
    backend.start(Backend(threads=1))
    for name, (law, nu, fracture, speed) in THRESHOLDS.items():
        for length in (0.0, H):
            works = []
            for cells in (COARSE, 2 * COARSE) if quick else (COARSE, 2 * COARSE, 4 * COARSE):
                f = replace(fracture, length=length)
                found = np.array([parting(law, nu, f, speed, cells, shift) for shift in SHIFTS])
                works.append(float(found[:, 0].mean()))
                what = f"{name}, fracture.length={length:g}"
                yield Row(what, f"h = {2 / cells:g} m: work to part a section", works[-1], "J/m^2")
                yield Row(what, f"h = {2 / cells:g} m: half the range over the places of the notch",
                          float(np.ptp(found[:, 0]) / 2), "J/m^2")  # fmt: skip
                yield Row(what, f"h = {2 / cells:g} m: nominal stretch at the break", float(found[:, 1].mean()), "1")
            spread = (max(works) - min(works)) / float(np.mean(works))
            yield Row(f"{name}, fracture.length={length:g}", "spread of the work over its mean", spread, "1",
                      most=0.1 if length else None)  # fmt: skip
