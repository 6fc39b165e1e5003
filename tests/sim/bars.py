"""Blocks and bars of particles on a lattice, and states without grips."""

from typing import Any

import numpy as np

from fracsim import Backend, Scene
from fracsim.mpm.state import State
from fracsim.records import Array, Particles
from fracsim.stress.bodies import bar, lattice, particles
from fracsim.stress.free import free, momentum

__all__ = ["angular_momentum", "bar", "driven", "free", "lattice", "momentum", "particles", "scene"]


def scene(**sections: Any) -> Scene:
    """A scene on one thread."""
    return Scene(**{"backend": Backend(threads=1), **sections})


def driven(scene: Scene, body: Particles, drive: str, chunks: int) -> State:
    """A state that runs its substeps by this drive, whatever the machine would choose."""

    class Driven(State):
        def _allocate(self, particles: Particles) -> None:
            self.drive, self.chunks = drive, chunks
            super()._allocate(particles)

    return Driven(scene, body)


def angular_momentum(state: State) -> Array:
    """Total angular momentum about the object's centre, the spin of the affine motion included [kg m^2/s].

    Over the nodes of a quadratic B-spline sum w (x_i - x_p)(x_i - x_p)^T = h^2 / 4 I in the grid's configuration, in
    which C is the gradient.
    """
    m = state.scene.material.density * state.volume.to_numpy().astype(np.float64)
    x = state.X0.astype(np.float64) + state.U.to_numpy()
    C, F = state.C.to_numpy().astype(np.float64), state.F.to_numpy().astype(np.float64)
    A = C @ F.transpose(0, 2, 1) if state.total else C
    spin = (
        state.scene.solver.h**2
        / 4
        * np.stack([A[:, 2, 1] - A[:, 1, 2], A[:, 0, 2] - A[:, 2, 0], A[:, 1, 0] - A[:, 0, 1]], axis=1)
    )
    return (m[:, None] * (np.cross(x, state.V.to_numpy()) + spin)).sum(axis=0)
