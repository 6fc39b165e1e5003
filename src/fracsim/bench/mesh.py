"""Dependence of the work of a crack on the cell size, with and without `fracture.length`."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fracsim import backend
from fracsim.bench.record import Row
from fracsim.lab.stage import lattice, particles
from fracsim.scene.vocab import Backend, Capture, Fracture, Loading, Material, Scene, Solver
from fracsim.solve.simulator import Simulator

COARSE = 50
"""Cells along 2 m of the coarsest bar."""
H = 2 / COARSE
"""Its cell size [m]."""
THRESHOLDS = {"low stretch": ("fixed_corotated", 0.3, Fracture(onset=1.5, crit=2.3), 0.03),
              "high stretch": ("neo_hookean", 0.45, Fracture(onset=2.6, crit=3.0), 0.1)}  # fmt: skip
"""Law, Poisson's ratio, thresholds, and speed of each grip [m/s] at E = 2e3 Pa: 1 and 3 % of sqrt(E / density)."""
SHIFTS = (0.1, 0.6)
"""Places of the notch [particle spacings]: it begins at a face of a cell, or in the middle of one."""
FRAMES, AFTER = 450, 3
"""Most frames until the bar parts, and frames after that in which the last ligaments tear. In these a wave crosses the
section and does not yet return from the grips."""


class Crack(NamedTuple):
    """The crack that parts a bar."""

    work: float
    """Energy lost to damage over the crack's area [J/m^2], the failed volume over the cell size."""
    width: float
    """Width of the crack along the pull [cells]."""
    stretch: float
    """Nominal stretch at the break."""


def parting(law: str, nu: float, fracture: Fracture, speed: float, cells: int, shift: float) -> Crack:
    """Pull a notched bar until it parts. One flank of the notch is steep, the other slopes: the crack is at the steep
    one, `shift` spacings from a face of a cell.
    """
    solver = Solver(cells=cells, damping="none")
    gap = solver.spacing
    X = lattice((20 * H, 6 * H, 4 * gap), gap)
    inside = X[:, 0] - 1 - 2 * H - shift * gap
    X = X[(inside < 0) | (np.abs(X[:, 1] - 1) < 1.5 * H + np.maximum(inside - H, 0))]
    duration = (fracture.onset - 1) * 1.2 * 16 * H / (2 * speed)
    scene = Scene(material=Material(law=law, E=2e3, nu=nu), fracture=fracture, solver=solver,
                  loading=Loading(offset=9 * H, thickness=2 * H, speed=speed, grips="sliding"),
                  capture=Capture(frames=FRAMES, fps=(FRAMES - 1) / duration), backend=Backend(threads=1))  # fmt: skip
    simulator = Simulator(scene, particles(X, gap))
    left = AFTER
    for _ in simulator.frames():
        left -= simulator.report.parted
        if not left:
            break
    failed = simulator.state.points.D.to_numpy() >= 1
    area = float(simulator.report.volume[failed].sum()) / solver.h
    planes = len(np.unique(np.round(simulator.particles.X[failed, 0] / gap * 4)))
    at = simulator.report.break_frame
    stretch = float("nan") if at is None else simulator.report.history.nominal_stretch[at]
    return Crack(simulator.report.energy()["damage"] / area if area else float("nan"), planes * gap / solver.h, stretch)


def study(out: Path, quick: bool) -> Iterator[Row]:
    """Cracks on cells h, h / 2 and h / 4, with fixed thresholds and with thresholds meant for the coarsest cells."""
    backend.start(Backend(threads=1))
    for name, (law, nu, fracture, speed) in THRESHOLDS.items():
        for length in (0.0, H):
            works = []
            for cells in (COARSE, 2 * COARSE) if quick else (COARSE, 2 * COARSE, 4 * COARSE):
                f = replace(fracture, length=length)
                found = np.array([parting(law, nu, f, speed, cells, shift) for shift in SHIFTS])
                work, width, stretch = found.mean(axis=0)
                works.append(float(work))
                what, h = f"{name}, fracture.length={length:g}", f"h = {2 / cells:g} m: "
                yield Row(what, h + "work of a crack", works[-1], "J/m^2")
                yield Row(
                    what, h + "half its range over the places of the notch", float(np.ptp(found[:, 0]) / 2), "J/m^2"
                )
                yield Row(what, h + "width of the crack", float(width), "cells")
                yield Row(what, h + "nominal stretch at the break", float(stretch), "1")
            spread = (max(works) - min(works)) / float(np.mean(works))
            yield Row(f"{name}, fracture.length={length:g}", "spread of the work over its mean", spread, "1",
                      most=0.1 if length else None)  # fmt: skip
