"""A uniform bar with free sides, pulled slowly: the closed form that the break of a scene is compared with."""

from dataclasses import dataclass, replace

import numpy as np

from fracsim.backend import has_doubles
from fracsim.mpm.state import reals
from fracsim.mpm.uniaxial_bar import stretcher
from fracsim.records import Array
from fracsim.scene.vocab import Scene

POINTS = 1000
"""Stretches at which a bar is looked at, from 1 to lambda_crit."""
BESIDE = 0.5
"""Length along which material was damaged up to the peak of the load before strain localised into a band of one cell,
over `fracture.length`: it belongs to the object, not to the cells (`python -m fracsim.bench mesh`)."""
MOST = 10.0
"""The largest lambda_crit of a scene."""


@dataclass(frozen=True)
class Bar:
    """Nominal stress against stretch."""

    stretch: Array
    """lambda, (M,)."""
    intact: Array
    """Nominal stress P without damage [Pa], (M,)."""
    damage: Array
    """d, (M,)."""

    @property
    def stress(self) -> Array:
        """Nominal stress (1 - d) P [Pa], (M,)."""
        out: Array = (1 - self.damage) * self.intact
        return out

    @property
    def breaks_at(self) -> float:
        """Stretch where the load peaks: a longer bar than a few cells parts there, not at lambda_crit."""
        return float(self.stretch[self.stress.argmax()])

    @property
    def work(self) -> float:
        """Work to break a unit of volume [J/m^3]."""
        return float(np.trapezoid(self.stress, self.stretch))

    def parting(self, h: float, length: float) -> float:
        """Work to part a section [J/m^2]: that of a band one cell of h [m] wide and that of the damage beside it."""
        energy = np.concatenate([[0.0], np.cumsum((self.intact[1:] + self.intact[:-1]) / 2 * np.diff(self.stretch))])
        peak = int(self.stress.argmax()) + 1
        return h * self.work + BESIDE * length * float(np.trapezoid(energy[:peak], self.damage[:peak]))


def bar(scene: Scene, crit: float | None = None) -> Bar:
    """The bar of a scene's material, with another lambda_crit if given."""
    m, f = scene.material, scene.fracture
    crit = f.crit if crit is None else crit
    real, dtype = reals("float64" if has_doubles(scene.backend) else "float32")
    stretch = np.linspace(1, crit, POINTS, dtype=dtype)
    P, d = np.zeros(POINTS, dtype), np.zeros(POINTS, dtype)
    stretcher(m.law, f.law, real)(m.mu, m.lam, f.onset, crit, stretch, P, d)
    return Bar(stretch, P, d)


def regularised(scene: Scene) -> Scene:
    """The scene with the lambda_crit that its cells need; itself when `fracture.length` is 0.

    Strain localises into a band about as wide as a cell, so the work to part a unit of section falls with h:
    lambda_crit is chosen such that it stays what it is with cells of `fracture.length` (the crack band of Bazant and
    Oh 1983). Raises ValueError when no lambda_crit does that.
    """
    f, h = scene.fracture, scene.solver.h
    if not f.length:
        return scene

    def parting(crit: float) -> float:
        return bar(scene, crit).parting(h, f.length)

    wanted = bar(scene).parting(f.length, f.length)
    low, high = f.onset * (1 + 1e-6), MOST
    if parting(high) < wanted:
        raise ValueError(
            f"fracture.length={f.length:g} m with cells of {h:.3g} m asks for a lambda_crit above {MOST:g}: use fewer "
            "solver.cells or a smaller fracture.length."
        )
    if parting(low) > wanted:
        largest = wanted / bar(scene, low).parting(1.0, 0.0)
        raise ValueError(
            f"fracture.length={f.length:g} m cannot be kept by cells of {h:.3g} m: they take more work to reach "
            f"fracture.onset={f.onset:g} than it leaves. Use cells of at most {largest:.3g} m (solver.cells) or a "
            "larger fracture.length."
        )
    for _ in range(30):
        crit = (low + high) / 2
        low, high = (crit, high) if parting(crit) < wanted else (low, crit)
    return replace(scene, fracture=replace(f, crit=high, length=0.0))
