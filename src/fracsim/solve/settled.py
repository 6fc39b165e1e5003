"""When a torn object has come to rest, and how its pieces then move unsimulated (`solver.until=settled`)."""

import numpy as np

from fracsim.records import Array
from fracsim.scene.vocab import Loading

STILL = 0.03
"""A piece has settled when the velocity of each of its particles differs from its grip's by at most this part of the
grips' speed ..."""
CHANGE = 3e-3
"""... and no F changes by more than this in a frame."""


class Settled:
    """Pieces that have settled: each moves with the grip that holds it, or rests."""

    def __init__(self, loading: Loading, frame: float, side: Array) -> None:
        """`frame`: time between frames [s]; `side`: the grip, -1 or +1, that holds each particle, else 0, (N,)."""
        self.loading, self.frame, self.side = loading, frame, side
        self.velocity: Array | None = None
        """Velocities of the particles once settled [m/s], (N, 3)."""

    def __bool__(self) -> bool:
        return self.velocity is not None

    def update(self, v: Array, C: Array, failed: Array, fragment: Array) -> None:
        """Decide whether the intact particles with velocities v (N, 3) and gradients C (N, 3, 3) have settled."""
        load = self.loading
        if failed.all():
            self.velocity = np.zeros_like(v)
            return
        grip = np.zeros(fragment.max() + 1)
        held = (self.side != 0) & (fragment >= 0)
        np.add.at(grip, fragment[held], self.side[held])
        expected = np.sign(grip)[np.maximum(fragment, 0), None] * load.speed * np.asarray(load.axis)
        off, change = np.linalg.norm(v - expected, axis=1), np.abs(C).max(axis=(1, 2)) * self.frame
        if (off[~failed] < STILL * load.speed).all() and (change[~failed] < CHANGE).all():
            self.velocity = np.where(failed[:, None], 0.0, expected)

    def displacement(self) -> Array:
        """How far the particles move in a frame [m], (N, 3)."""
        assert self.velocity is not None
        return self.frame * self.velocity
