"""Bars between sliding grips, pulled by the whole simulator until they break."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from fracsim.lab.stage import lattice, particles
from fracsim.records import Array
from fracsim.scene.vocab import CENTRE, Backend, Capture, Fracture, Loading, Material, Scene, Solver
from fracsim.solve.simulator import Simulator
from fracsim.verify.closed_form import uniaxial

HELD = 2
"""Thickness of a grip [cells]."""
PLACES = tuple((k + 0.5) / 8 for k in range(8))
"""Tested places of the grips' faces between two nodes [cells]."""


@dataclass(frozen=True)
class TensileBar:
    """A bar along x; all lengths in m."""

    gauge: float
    """Length between the faces of the grips."""
    width: float
    height: float
    notch: float = 0.0
    """Depth of the notch in both faces across y."""
    at: float = 0.0
    """Place of the notch from the middle."""

    @property
    def section(self) -> float:
        """Area of the section without notch [m^2]."""
        return self.width * self.height

    def points(self, solver: Solver) -> Array:
        """Rest positions [m], (N, 3); the notch is one cell long."""
        h = solver.h
        X = lattice((self.gauge + 2 * HELD * h, self.width, self.height), solver.spacing)
        across = np.abs(X[:, 1] - 1) > self.width / 2 - self.notch
        return np.asarray(X[~(across & (np.abs(X[:, 0] - 1 - self.at) < h / 2))])


def simulator(
    solver: Solver, bar: TensileBar, material: Material, fracture: Fracture, speed: float, stretch: float, frames: int
) -> Simulator:
    """The bar, pulled to the nominal stretch `stretch` in `frames` frames, the faces of its grips on nodes.

    `speed` of each grip is a fraction of the wave speed sqrt(E / density).
    """
    h, v = solver.h, speed * np.sqrt(material.E / material.density)
    duration = (stretch - 1) * bar.gauge / (2 * v)
    loading = Loading(offset=bar.gauge / 2 + h * HELD / 2, thickness=HELD * h, speed=v, grips="sliding")
    scene = Scene(material=material, fracture=fracture, loading=loading, solver=solver, backend=Backend(threads=1),
                  capture=Capture(frames=frames, fps=(frames - 1) / duration))  # fmt: skip
    return Simulator(scene, particles(bar.points(solver), solver.spacing))


def until_parted(simulator: Simulator) -> Array | None:
    """Run until the bar parts or the frames end; rest positions [m], (M, 3), of the particles that failed first."""
    first = None
    for frame in simulator.frames():
        if first is None and frame.failed.any():
            first = simulator.particles.X[frame.failed].astype(float)
        if simulator.report.parted:
            break
    return first


def at_peak(simulator: Simulator) -> tuple[float, float]:
    """Nominal stretch and load [N] at the largest load. The load of a frame is its mean since the previous frame."""
    history = simulator.report.history
    k = int(np.argmax(history.load))
    return (history.nominal_stretch[k] + history.nominal_stretch[k - 1]) / 2, history.load[k]


def at_break(simulator: Simulator) -> float:
    """Nominal stretch at which damage parted the bar, or NaN."""
    frame = simulator.report.break_frame
    return float("nan") if frame is None else simulator.report.history.nominal_stretch[frame]


def over_gauge(simulator: Simulator, law: str, nu: float, stretch: float, load: float) -> float:
    """Nominal stretch of a bar whose middle has the stretch `stretch`, at the load / section / E `load`.

    What of it is exempt from damage has the stretch of the undamaged law at this load.
    """
    s = (simulator.particles.X.astype(np.float64) - CENTRE) @ np.asarray(simulator.scene.loading.axis)
    ends = float((~simulator.report.free[np.abs(s) < simulator.scene.loading.gauge / 2]).mean())
    held = float(brentq(lambda l: uniaxial(law, nu, l)[0] - load, 1, stretch + 1e-9))
    return (1 - ends) * stretch + ends * held
