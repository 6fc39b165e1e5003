"""When a torn object has come to rest, and how its pieces move on without being simulated (`solver.until=settled`)."""

import numpy as np

from fracsim.records import Array
from fracsim.scene.vocab import Scene

STILL = 0.03
"""A piece is settled when all its particles move with it to this part of the grips' speed ..."""
CHANGE = 3e-3
"""... and no F changes by more than this in a frame."""


class Rest:
    """The pieces of an object from the frame on at which it had settled: each moves on with the grip that holds it."""

    def __init__(self, scene: Scene, side: Array) -> None:
        self.scene, self.side = scene, side
        self.velocity: Array | None = None
        """Velocities of the particles once settled [m/s], (N, 3)."""

    @property
    def settled(self) -> bool:
        """Whether nothing but such motion is left."""
        return self.velocity is not None

    def look(self, v: Array, C: Array, failed: Array, fragment: Array) -> None:
        """Decide whether the intact particles with velocities v (N, 3) and gradients C (N, 3, 3) have settled."""
        load = self.scene.loading
        if failed.all():
            self.velocity = np.zeros_like(v)
            return
        grip = np.zeros(fragment.max() + 1)
        held = (self.side != 0) & (fragment >= 0)
        np.add.at(grip, fragment[held], self.side[held])
        due = np.sign(grip)[np.maximum(fragment, 0), None] * load.speed * np.asarray(load.axis)
        off, change = np.linalg.norm(v - due, axis=1), np.abs(C).max(axis=(1, 2)) / self.scene.capture.fps
        if (off[~failed] < STILL * load.speed).all() and (change[~failed] < CHANGE).all():
            self.velocity = np.where(failed[:, None], 0.0, due)

    def way(self, seconds: float) -> Array:
        """How far the particles move in some seconds [m], (N, 3)."""
        assert self.velocity is not None
        return seconds * self.velocity
