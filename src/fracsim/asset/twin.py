"""Twins: the same object with other particles. They show how far a result depends on where particles happen to lie.

A seed above 0 shifts the lattice of the filling by a random part of a spacing along each axis. The outline and the
total volume stay; seed 0 is the centred lattice.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np

from fracsim.asset.fill import Solid, volume
from fracsim.records import Array


def twin(solid: Solid, spacing: float, seed: int, same: Callable[[], Solid] | None = None) -> Solid:
    """The solid as it is to be filled with particles `spacing` [m] apart for `seed`; `solid` itself for seed 0.

    `same` makes the solid a second time; it is needed where `solid.distance` remembers the grid it was asked for.
    """
    return Twin(solid, spacing, seed, same or (lambda: solid)) if seed else solid


class Twin:
    """A solid whose bounding box, and so its lattice, is shifted by up to half a spacing along each axis."""

    def __init__(self, solid: Solid, spacing: float, seed: int, same: Callable[[], Solid]) -> None:
        self._solid, self._spacing, self._same = solid, spacing, same
        shift = spacing * (np.random.default_rng(seed).random(3) - 0.5)
        lo, hi = solid.bounds
        self.bounds = lo + shift, hi + shift

    @cached_property
    def volume(self) -> float:
        """The volume of the particles for seed 0 [m^3]: twins have the same mass."""
        exact = self._solid.volume
        return volume(self._same(), self._spacing) if exact is None else exact

    def distance(self, axes: list[Array]) -> Array:
        """Signed distances (nx, ny, nz) [m] on a grid, as in `fracsim.asset.fill.Solid`."""
        return self._solid.distance(axes)

    def contains(self, axes: list[Array], index: Array) -> Array:
        """Whether the grid points `index` (M, 3) are inside, (M,) bool, as in `fracsim.asset.fill.Solid`."""
        return self._solid.contains(axes, index)

    def settle(self, P: Array, depth: float) -> tuple[Array, Array]:
        """Points P (N, 3) moved to a depth, and normals (N, 3), as in `fracsim.asset.fill.Solid`."""
        return self._solid.settle(P, depth)
