"""A bar with a notch one cell deep, off centre: it fails first at the notch, and then through its section."""

from collections.abc import Iterator

import numpy as np

from fracsim.scene.vocab import Fracture, Material
from fracsim.verify.problem import Check, Setting, absolute, reported
from fracsim.verify.pull import TensileBar, at_break, simulator, until_parted

H = 2 / 50
"""Cell size [m]."""
BAR = TensileBar(gauge=16 * H, width=6 * H, height=4 * H, notch=H, at=3 * H)
MATERIAL, FRACTURE = Material(law="fixed_corotated", E=2e3, nu=0.3), Fracture(onset=1.5, crit=2.3)


def run(setting: Setting) -> Iterator[Check]:
    """Distances of the first and of all failed particles from the plane of the notch [cells]; break stretch."""
    sim = simulator(setting.solver(50), BAR, MATERIAL, FRACTURE, 0.02, 1.9, 300)
    first = until_parted(sim)
    away = np.nan if first is None else float(np.abs(first[:, 0] - 1 - BAR.at).max() / H)
    yield absolute("first failure from the notch", 0, away, 1.0, unit="cells")
    failed = sim.particles.X[sim.state.points.D.to_numpy() >= 1].astype(float)
    far = float(np.abs(failed[:, 0] - 1 - BAR.at).max() / H) if len(failed) else np.nan
    yield reported("farthest failure from the notch", far, "cells")
    yield reported("break stretch", at_break(sim))
