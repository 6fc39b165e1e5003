"""The bar on which substeps are timed: 0.6 x 0.2 x 0.2 m of fixed-corotated solid, 8 particles a cell."""

import math

import numpy as np

from fracsim.records import Array
from fracsim.scene.vocab import CENTRE, DT0, H0, Material

E, NU, DENSITY = 2e3, 0.3, 200.0
"""Young's modulus [Pa], Poisson's ratio, density [kg/m^3]."""
RPIC, KEEP = 0.5, 0.9995
"""The paper's damping in a substep: r of RPIC, and the part of its velocity that a node keeps."""
DT = DT0
"""Substep [s]."""
SIZE = (0.6, 0.2, 0.2)
"""Edges [m]; 81,000 particles when h = 2/150 m."""
SPIN = np.array([[0.8, -0.5, 0.0], [0.5, -0.3, 0.2], [0.0, -0.2, -0.3]])
"""Velocity gradient at t = 0 [1/s], (3, 3): stretch and rotation."""


def material(law: str) -> Material:
    """The solid for this project's solver; with solver.damping=per_substep it has the damping RPIC and KEEP."""
    viscosity = RPIC * DENSITY * H0**2 / (4 * DT0)
    return Material(law=law, E=E, nu=NU, density=DENSITY, viscosity=viscosity, decay=-math.log(KEEP) / DT0)


def lattice(h: float) -> Array:
    """Rest positions [m], (N, 3) float32, two particles per cell of size h [m] and axis, symmetric about the centre."""
    spacing = h / 2
    axes = [c + spacing * (np.arange(n) - (n - 1) / 2) for c, n in zip(CENTRE, _counts(spacing), strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3).astype(np.float32)


def _counts(spacing: float) -> list[int]:
    """Numbers of particles along x, y and z."""
    return [max(1, round(edge / spacing)) for edge in SIZE]


def velocity(X: Array) -> Array:
    """Velocities at t = 0 [m/s], (N, 3) float32, at rest positions X (N, 3) [m]."""
    v: Array = ((X - np.asarray(CENTRE)) @ SPIN.T).astype(np.float32)
    return v
