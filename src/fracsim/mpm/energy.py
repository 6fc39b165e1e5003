"""Kinetic energies of one simulation."""

import numpy as np

from fracsim.mpm.state import State
from fracsim.mpm.survey import node_energies
from fracsim.records import Array


def kinetic(state: State) -> Array:
    """Kinetic energy of the grid [J], shared out among the particles that give it its mass, (N,) float64.

    Failed particles of `total` have none. Before nodes have moved, and in `updated`, whose nodes are gone by the end of
    a substep, it is that of the particles.
    """
    if state.first_substep or not state.total:
        return kinetic_of_particles(state)
    params, energy = state.params.astype(state.dtype), np.empty(state.n, state.dtype)
    b, grid = state.points, state.grid
    node_energies(state.real)(params, b.X, b.D, *grid.layout.strides, grid.velocity, energy)
    return np.asarray(masses(state) * energy)


def kinetic_of_particles(state: State) -> Array:
    """Kinetic energies of the particles, that of their affine motion included [J], (N,) float64."""
    v, C = (a.to_numpy().astype(np.float64) for a in (state.points.V, state.points.C))
    square = (v**2).sum(axis=1) + state.medium.h**2 / 4 * (C**2).sum(axis=(1, 2))
    return np.asarray(masses(state) / 2 * square)


def masses(state: State) -> Array:
    """Masses of the particles [kg], (N,) float64."""
    return np.asarray(state.medium.material.density * state.points.volume.to_numpy().astype(np.float64))
