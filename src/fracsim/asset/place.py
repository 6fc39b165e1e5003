"""Placement of an object: turned, scaled to its largest extent, its bounding box centred in the domain.

y is up, as in glTF. OBJ and STL files drawn with z up need asset.rotate_deg=[-90,0,0], and a trained 3DGS file in
the axes of COLMAP (y down) needs asset.rotate_deg=[180,0,0].
"""

import math
from dataclasses import dataclass

import numpy as np

from fracsim.records import Array
from fracsim.scene.vocab import CENTRE, Asset

HOME: Array = np.array(CENTRE)
"""Centre of the object's bounding box in the world [m], (3,)."""


@dataclass(frozen=True)
class Placement:
    """The similarity W = scale (R p - middle) + HOME from object coordinates p to the world [m]."""

    R: Array
    """Rotation, (3, 3)."""
    scale: float
    """Metres in the world per unit of the object."""
    middle: Array
    """Centre of the bounding box of the turned object, (3,)."""

    def to_world(self, P: Array) -> Array:
        """Points in the world [m], (..., 3), of points P of the object, (..., 3)."""
        world: Array = self.scale * (P @ self.R.T - self.middle) + HOME
        return world

    def turned(self, T: Array) -> "Placement":
        """The same placement in a world turned by T, (3, 3), about HOME."""
        return Placement(T @ self.R, self.scale, T @ self.middle)

    def to_object(self, W: Array) -> Array:
        """Points of the object, (N, 3), of points W in the world [m], (N, 3)."""
        points: Array = ((W - HOME) / self.scale + self.middle) @ self.R
        return points


def rotation(degrees: list[float]) -> Array:
    """The rotation, (3, 3) float64, about x, then y, then z (fixed axes, right-handed) by three angles [deg]."""
    R = np.eye(3)
    for axis, angle in enumerate(degrees):
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
        R = turn @ R
    return R


def fit(asset: Asset, lo: Array, hi: Array) -> Placement:
    """The placement that scales the turned bounding box [lo, hi], (3,) each, to asset.size.

    Raises ValueError if the box has no extent.
    """
    extent = float(np.max(hi - lo))
    if not (math.isfinite(extent) and extent > 0):
        raise ValueError(
            f"asset.path={asset.path}: the object has the extent {extent:g}, it cannot be scaled to "
            f"asset.size={asset.size:g} m. Give a file whose points differ and are finite."
        )
    return Placement(rotation(asset.rotate_deg), asset.size / extent, (lo + hi) / 2)
