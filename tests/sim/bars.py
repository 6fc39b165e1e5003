"""Blocks and bars of particles on a lattice, and states without grips."""

from typing import Any

import numpy as np

from fracsim import Backend, Scene, Solver
from fracsim.mpm import params as slot
from fracsim.mpm.layout import Layout
from fracsim.mpm.state import State
from fracsim.records import Array, Particles
from fracsim.vocab import CENTRE


def lattice(size: tuple[float, float, float], spacing: float, centre: tuple[float, float, float] = CENTRE) -> Array:
    """Cell-centred lattice points of a box, (N, 3) float32."""
    counts = [max(1, round(s / spacing)) for s in size]
    axes = [c + spacing * (np.arange(n) - (n - 1) / 2) for c, n in zip(centre, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3).astype(np.float32)


def particles(X: Array, spacing: float) -> Particles:
    """Particles of equal volume and grey colour."""
    n = len(X)
    covariance = np.tile(np.float32([1, 0, 0, 1, 0, 1]) * np.float32(0.36 * spacing**2), (n, 1))
    return Particles(
        X=X.astype(np.float32),
        volume=np.full(n, spacing**3, np.float32),
        covariance=covariance,
        opacity=np.full(n, 0.95, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
        surface=np.zeros(n, bool),
        spacing=spacing,
    )


def bar(solver: Solver, size: tuple[float, float, float] = (0.6, 0.2, 0.2)) -> Particles:
    """A bar along x, filled at the solver's spacing."""
    return particles(lattice(size, solver.spacing), solver.spacing)


def scene(**sections: Any) -> Scene:
    """A scene on one thread."""
    return Scene(**{"backend": Backend(threads=1), **sections})


class FreeState(State):
    """A state whose nodes no grip holds."""

    def _place_grid(self, grid: Layout, x: Array) -> None:
        super()._place_grid(grid, x)
        self.owner.fill(0)


def free(scene: Scene, body: Particles) -> State:
    """A state whose particles and nodes no grip holds, at rest."""
    state = FreeState(scene, body)
    state.K[slot.HALF] = -1.0
    state.label.from_numpy(np.full(len(body), slot.FREE, np.int32))
    state.V.from_numpy(np.zeros((len(body), 3), state.dtype))
    return state


def driven(scene: Scene, body: Particles, drive: str, chunks: int) -> State:
    """A state that runs its substeps by this drive, whatever the machine would choose."""

    class Driven(State):
        def _allocate(self, particles: Particles) -> None:
            self.drive, self.chunks = drive, chunks
            super()._allocate(particles)

    return Driven(scene, body)


def momentum(state: State) -> Array:
    """Total linear momentum [kg m/s]."""
    m = state.scene.material.density * state.volume.to_numpy().astype(np.float64)
    return (m[:, None] * state.V.to_numpy()).sum(axis=0)


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
