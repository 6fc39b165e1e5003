"""Kinetic energies of one simulation."""

import numpy as np

from fracsim.mpm.state import State
from fracsim.mpm.survey import shares
from fracsim.records import Array


def kinetic(state: State) -> Array:
    """Kinetic energy of the grid [J], shared out among the particles that give it its mass, (N,) float64.

    Failed particles of `total` have none. Before nodes have moved, and in `updated`, whose nodes are gone by the end of
    a substep, it is that of the particles.
    """
    if state.fresh or not state.total:
        return kinetic_of_particles(state)
    state.parameters.from_numpy(state.K.astype(state.dtype))
    evaluate = shares(state.real)
    evaluate(state.parameters, state.X, state.D, *state.layout.strides, state.velocity, state.share)
    return np.asarray(masses(state) * state.share.to_numpy())


def kinetic_of_particles(state: State) -> Array:
    """Kinetic energies of the particles, that of their affine motion included [J], (N,) float64."""
    v, C = (a.to_numpy().astype(np.float64) for a in (state.V, state.C))
    square = (v**2).sum(axis=1) + state.scene.solver.h**2 / 4 * (C**2).sum(axis=(1, 2))
    return np.asarray(masses(state) / 2 * square)


def masses(state: State) -> Array:
    """Masses of the particles [kg], (N,) float64."""
    return np.asarray(state.scene.material.density * state.volume.to_numpy().astype(np.float64))
