"""What the particles of a body are made of, and how their motion is computed: all that the solver needs of a scene."""

from dataclasses import dataclass

from fracsim.scene.vocab import Fracture, Material, Solver


@dataclass(frozen=True)
class Medium:
    """Material, thresholds, numerics and gravity."""

    material: Material
    fracture: Fracture
    """With the lambda_crit that the cells need (see `fracsim.solve.uniaxial`)."""
    solver: Solver
    gravity: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Acceleration [m/s^2]."""

    @property
    def h(self) -> float:
        """Cell size [m]."""
        return self.solver.h

    @property
    def total(self) -> bool:
        """Whether weights come from the rest configuration."""
        return self.solver.formulation == "total"
