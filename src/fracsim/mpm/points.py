"""The particles of one simulation on the device."""

from typing import Any

import numpy as np
import taichi as ti

from fracsim.arrays import Arrays
from fracsim.mpm.context import ParticleArrays
from fracsim.mpm.dilatation import PAGE, PLACES
from fracsim.mpm.layout import cell_counts
from fracsim.records import Array


class Deformation:
    """Deformation gradients F, (N, 3, 3); the device stores F - I."""

    def __init__(self, grad_u: Any) -> None:
        self._grad_u = grad_u

    def to_numpy(self) -> Array:
        """F, in the precision of the simulation, (N, 3, 3)."""
        grad_u: Array = self._grad_u.to_numpy()
        F: Array = grad_u + np.eye(3, dtype=grad_u.dtype)
        return F

    def from_numpy(self, F: Array) -> None:
        """Set F, (N, 3, 3)."""
        self._grad_u.from_numpy(F - np.eye(3, dtype=F.dtype))


class Points:
    """Device arrays of N particles at rest at X0 [m from the object's centre], (N, 3); see `ParticleArrays`."""

    def __init__(self, X0: Array, volume: Array, tag: Array, real: Any, forced: bool) -> None:
        """`volume` [m^3] and `tag` are (N,); `forced`: whether body forces act, which `force` holds [m/s^2]."""
        n, self._real, self._arrays = len(X0), real, Arrays(self)
        make = self._arrays
        self.X = make.of(X0, real, (3,))
        self.U, self.V, self.anchor = (make.zeros(real, n, element=(3,)) for _ in range(3))
        self.C, self.grad_u = (make.zeros(real, n, element=(3, 3)) for _ in range(2))
        self.D, self.volume, self.tag = make.zeros(real, n), make.of(volume, real), make.of(tag, ti.i32)
        self.force = make.zeros(real, n if forced else 1, element=(3,))
        self.F = Deformation(self.grad_u)

    def group_by_cell(self, y: Array | None, threads: int) -> Array | None:
        """Group particles by rest cell, for y [cells], (N, 3), sorted by cell; None makes no groups.

        Returns the first particle of each cell, (cells,), or None. Splitting into fragments keeps the groups.
        """
        counts = np.zeros(1, np.int32) if y is None else cell_counts(y)
        self.cell_counts = self._arrays.of(counts, ti.i32)
        self.theta = self._arrays.of(np.ones(len(counts)), self._real)
        places = max(PAGE, PLACES << max(int(counts.max()) - 1, 0).bit_length())
        self.scratch = self._arrays.zeros(self._real, threads, places, element=(4,))
        return None if y is None else np.flatnonzero(counts)

    def arrays(self) -> tuple[Any, ...]:
        """The arrays in the order of `ParticleArrays`."""
        return tuple(getattr(self, name) for name in ParticleArrays._fields)

    def changing(self) -> tuple[Any, ...]:
        """The arrays that substeps change."""
        return self.U, self.V, self.C, self.grad_u, self.D
