"""The frame of the lattices of nodes and particles at rest: the world, turned about z through the objects' centre.

The simulation runs in this frame, whose axes are those of its grid. With `solver.lattice=axis` the tearing axis is one
of them: the faces of the grips then lie along planes of nodes, and so do the sides of a bar that is pulled along its
length. A side that lies across the grid leaves cells partly filled, whose few particles integrate forces badly.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fracsim.asset.place import HOME, rotation
from fracsim.records import Array, Particles
from fracsim.scene.vocab import Scene


@dataclass(frozen=True)
class LatticeFrame:
    """A frame that is turned against the world by an angle; at 0 it is the world, bit for bit."""

    degrees: float = 0.0
    """Counter-clockwise about z [deg]."""

    @cached_property
    def R(self) -> Array:
        """The frame's axes as columns, in the world, (3, 3)."""
        return rotation([0.0, 0.0, self.degrees])

    def points(self, P: Array) -> Array:
        """Points of the world [m], (N, 3), in the frame."""
        return ((P.astype(np.float64) - HOME) @ self.R + HOME).astype(P.dtype) if self.degrees else P

    def vectors(self, v: Array) -> Array:
        """Vectors of the world, (..., 3), in the frame."""
        return (v @ self.R).astype(v.dtype) if self.degrees else v

    def points_to_world(self, P: Array) -> Array:
        """Points of the frame [m], (N, 3), in the world."""
        return ((P.astype(np.float64) - HOME) @ self.R.T + HOME).astype(P.dtype) if self.degrees else P

    def vectors_to_world(self, v: Array) -> Array:
        """Vectors of the frame, (..., 3), in the world."""
        return (v @ self.R.T).astype(v.dtype) if self.degrees else v

    def tensors_to_world(self, A: Array) -> Array:
        """Tensors of the frame, (N, 3, 3), in the world."""
        return (self.R @ A @ self.R.T).astype(A.dtype) if self.degrees else A

    def to_world(self, particles: Particles) -> Particles:
        """Particles that were prepared in the frame, in the world; colours are those of the world in both."""
        if not self.degrees:
            return particles
        rows, columns = np.triu_indices(3)
        full = np.empty((len(particles), 3, 3))
        full[:, rows, columns] = full[:, columns, rows] = particles.covariance
        covariance = self.tensors_to_world(full)[:, rows, columns].astype(np.float32)
        return replace(particles, X=self.points_to_world(particles.X), covariance=covariance)

    def scene(self, scene: Scene) -> Scene:
        """A scene with axis and gravity in the frame."""
        load, turned = scene.loading, scene.loading.axis_deg - self.degrees
        gravity = [float(g) for g in self.vectors(np.array(load.gravity, float))]
        return replace(scene, loading=replace(load, axis_deg=turned, gravity=gravity)) if self.degrees else scene


WORLD = LatticeFrame()
"""The frame that is the world."""
