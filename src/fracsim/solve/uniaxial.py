"""A uniform bar with free sides, pulled slowly: the closed form to which the break of a scene is compared."""

from dataclasses import dataclass

import numpy as np

from fracsim.backend import computes_doubles
from fracsim.mpm.medium import Medium
from fracsim.mpm.state import reals
from fracsim.mpm.uniaxial_bar import stretcher
from fracsim.records import Array

POINTS = 1000
"""Number of stretches, from 1 to lambda_crit, at which the bar is evaluated."""
BESIDE = 0.5
"""Length along which material was damaged up to the peak of the load before strain localised into a band of one cell,
over `fracture.length`: it belongs to the object, not to the cells (`python -m fracsim.bench mesh`)."""
MOST = 10.0
"""The largest lambda_crit of a scene."""


@dataclass(frozen=True)
class UniaxialBar:
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
        """Stretch at the peak of the load: a bar longer than a few cells parts there, not at lambda_crit."""
        return float(self.stretch[self.stress.argmax()])

    @property
    def work(self) -> float:
        """Work to break a unit of volume [J/m^3]."""
        return float(np.trapezoid(self.stress, self.stretch))

    def work_to_part(self, h: float, length: float) -> float:
        """Work to part a section [J/m^2]: that of a band one cell of h [m] wide, and that of the damage beside it."""
        energy = np.concatenate([[0.0], np.cumsum((self.intact[1:] + self.intact[:-1]) / 2 * np.diff(self.stretch))])
        peak = int(self.stress.argmax()) + 1
        return h * self.work + BESIDE * length * float(np.trapezoid(energy[:peak], self.damage[:peak]))


def uniaxial_bar(medium: Medium, crit: float | None = None) -> UniaxialBar:
    """The bar of a medium, with another lambda_crit if given."""
    m, f = medium.material, medium.fracture
    crit = f.crit if crit is None else crit
    real, dtype = reals("float64" if computes_doubles() else "float32")
    stretch = np.linspace(1, crit, POINTS, dtype=dtype)
    P, d = np.zeros(POINTS, dtype), np.zeros(POINTS, dtype)
    stretcher(m.law, f.law, real)(m.mu, m.lam, f.onset, crit, stretch, P, d)
    return UniaxialBar(stretch, P, d)


def rescaled_crit(medium: Medium, length: float) -> float:
    """The lambda_crit that the medium's cells need when its thresholds belong to cells of `length` [m]; 0: as given.

    Strain localises into a band about as wide as a cell, so the work to part a unit of section falls with h:
    lambda_crit is chosen such that this work stays what it is with cells of `length` (the crack band of Bazant and Oh
    1983). Raises ValueError when no lambda_crit does that.
    """
    f, h = medium.fracture, medium.h
    if not length:
        return f.crit

    def work(crit: float) -> float:
        return uniaxial_bar(medium, crit).work_to_part(h, length)

    wanted = uniaxial_bar(medium).work_to_part(length, length)
    low, high = f.onset * (1 + 1e-6), MOST
    if work(high) < wanted:
        raise ValueError(
            f"fracture.length={length:g} m with cells of {h:.3g} m asks for a lambda_crit above {MOST:g}: use fewer "
            "solver.cells or a smaller fracture.length."
        )
    if work(low) > wanted:
        largest = wanted / uniaxial_bar(medium, low).work_to_part(1.0, 0.0)
        raise ValueError(
            f"fracture.length={length:g} m cannot be kept by cells of {h:.3g} m: they take more work to reach "
            f"fracture.onset={f.onset:g} than it leaves. Use cells of at most {largest:.3g} m (solver.cells) or a "
            "larger fracture.length."
        )
    for _ in range(30):
        crit = (low + high) / 2
        low, high = (crit, high) if work(crit) < wanted else (low, crit)
    return high
