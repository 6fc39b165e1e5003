"""A case under construction: its fields so far, and the generator that the next ones are drawn from."""

import math
from typing import Any

import numpy as np

from fracsim.fuzz.bodies import points
from fracsim.fuzz.case import Case


class Draft:
    """A case under construction; `seed` and `number` alone determine the drawn numbers."""

    def __init__(self, family: str, seed: int, number: int) -> None:
        self.rng = np.random.default_rng([seed, number])
        self.case = Case(family=family, seed=seed, number=number, scene={})
        self.steps = 0
        """Substeps of the run; 0: from the cost of the scene."""
        self.dt_factor = 0.0
        """Fixed substep over the stability bound at rest; 0: solver.dt=auto."""

    def set(self, field: str, value: Any) -> None:
        """Set a field such as `material.E`."""
        section, name = field.split(".")
        self.case.scene.setdefault(section, {})[name] = value

    def get(self, field: str) -> Any:
        """A field that is already set; raises KeyError for another."""
        section, name = field.split(".")
        return self.case.scene[section][name]

    def uniform(self, low: float, high: float) -> float:
        """A uniform number, rounded to six digits for a readable file."""
        return float(f"{self.rng.uniform(low, high):.6g}")

    def log(self, low: float, high: float) -> float:
        """A number uniform in its logarithm, rounded to six digits."""
        return float(f"{math.exp(self.rng.uniform(math.log(low), math.log(high))):.6g}")

    def choose(self, *values: Any) -> Any:
        """One of the values, each equally likely."""
        return values[int(self.rng.integers(len(values)))]

    def counts(self, *ranges: tuple[int, int]) -> None:
        """Draw the numbers of particles along x, y, z, each between two limits."""
        self.case.body.counts = [int(self.rng.integers(low, high + 1)) for low, high in ranges]

    @property
    def wave(self) -> float:
        """Wave speed sqrt(E / density) [m/s]."""
        return math.sqrt(float(self.get("material.E") / self.get("material.density")))

    @property
    def spacing(self) -> float:
        """Particle spacing at rest [m]."""
        return 2.0 / (float(self.get("solver.cells")) * float(self.get("solver.particles_per_axis")))

    @property
    def length(self) -> float:
        """Extent of the object along x [m]."""
        return self.extent(0.0)

    def extent(self, axis_deg: float) -> float:
        """Extent of the object along an axis in the image plane [m]."""
        a = math.radians(axis_deg)
        along = points(self.case.body) @ [math.cos(a), math.sin(a), 0.0]
        return float(np.ptp(along) + 1) * self.spacing
