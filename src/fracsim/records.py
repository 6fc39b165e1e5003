"""Records of arrays that travel between the stages: particles at rest, a frame of the simulation."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
J_MIN = 0.05
"""Smallest volume ratio that divides, that of `fracsim.tensor`: a law takes J for 0.05 where it is smaller, also in
inverted material, so that tau belongs to this J."""


@dataclass(frozen=True)
class Particles:
    """Material points at rest, each also a Gaussian; N particles, K = (SH degree + 1)^2 coefficients."""

    X: Array
    """Rest positions [m], (N, 3) float32."""
    volume: Array
    """Rest volumes [m^3], (N,) float32; they sum to the object's true volume. One of 0 is drawn only: it rides on the
    particles around it.
    """
    covariance: Array
    """Rest covariances A_p as xx, xy, xz, yy, yz, zz [m^2], (N, 6) float32."""
    opacity: Array
    """Opacities in [0, 1], (N,) float32."""
    sh: Array
    """Spherical-harmonic colour coefficients in the layout of 3DGS, (N, K, 3) float32."""
    surface: Array
    """Whether the particle lies on the surface, (N,) bool."""
    spacing: float
    """Distance of interior particles at rest [m]."""
    notes: tuple[str, ...] = field(default=())
    """Remarks for the user on how the object was prepared."""

    def __post_init__(self) -> None:
        n = len(self.X)
        for name, tail in (("X", (3,)), ("volume", ()), ("covariance", (6,)), ("opacity", ()), ("surface", ())):
            shape = getattr(self, name).shape
            assert shape == (n, *tail), f"Particles.{name} has shape {shape}, expected {(n, *tail)}"
        assert self.sh.shape == (n, self.sh.shape[1], 3)

    def __len__(self) -> int:
        return len(self.X)


@dataclass(frozen=True)
class Frame:
    """The state of all particles at t = index / fps, in the order of `Particles`."""

    index: int
    t: float
    """Time [s]."""
    x: Array
    """Positions [m], (N, 3)."""
    v: Array
    """Velocities [m/s], (N, 3)."""
    F: Array
    """Deformation gradients, (N, 3, 3), with all stretches capped at lambda_crit, as those of exempt particles."""
    tau: Array
    """Degraded Kirchhoff stresses (1 - d) tau at this F [Pa], (N, 3, 3)."""
    d: Array
    """Damage in [0, 1], (N,)."""

    @property
    def J(self) -> Array:
        """Volume ratios det F, (N,)."""
        J: Array = np.linalg.det(self.F)
        return J

    @property
    def stress(self) -> Array:
        """Degraded Cauchy stresses tau / J [Pa], (N, 3, 3); J counts as J_MIN where it is smaller."""
        return np.asarray(self.tau / np.maximum(self.J, J_MIN)[:, None, None])

    @property
    def failed(self) -> Array:
        """Whether d reached 1, (N,) bool."""
        return self.d >= 1
