"""What the nodes of one simulation carry: kinetic energies and momenta."""

from typing import NamedTuple

import numpy as np

from fracsim.mpm.state import State
from fracsim.mpm.survey import node_motion
from fracsim.records import Array


class Carried(NamedTuple):
    """What the grid carries, shared out among the particles that give it its mass; failed ones of `total` give none."""

    kinetic: Array
    """Kinetic energy [J], (N,) float64."""
    momentum: Array
    """Momentum [N s], (N, 3) float64."""


def carried(state: State) -> Carried:
    """Kinetic energy and momentum of the grid.

    Before nodes have moved, and in `updated`, whose nodes are gone by the end of a substep, they are those of the
    particles.
    """
    mass = masses(state)
    if state.first_substep or not state.total:
        v = state.points.V.to_numpy().astype(np.float64)
        return Carried(kinetic_of_particles(state), mass[:, None] * v)
    params, energy = state.params.astype(state.dtype), np.empty(state.n, state.dtype)
    b, grid, v = state.points, state.grid, np.empty((state.n, 3), state.dtype)
    node_motion(state.real)(params, b.X, b.D, *grid.layout.strides, grid.velocity, energy, v)
    return Carried(mass * energy, mass[:, None] * v)


def kinetic(state: State) -> float:
    """Kinetic energy of the grid [J]."""
    return float(carried(state).kinetic.sum())


def kinetic_of_particles(state: State) -> Array:
    """Kinetic energies of the particles, that of their affine motion included [J], (N,) float64."""
    v, C = (a.to_numpy().astype(np.float64) for a in (state.points.V, state.points.C))
    square = (v**2).sum(axis=1) + state.medium.h**2 / 4 * (C**2).sum(axis=(1, 2))
    return np.asarray(masses(state) / 2 * square)


def masses(state: State) -> Array:
    """Masses of the particles [kg], (N,) float64."""
    return np.asarray(state.medium.material.density * state.points.volume.to_numpy().astype(np.float64))
