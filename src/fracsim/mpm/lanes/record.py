"""Where the numbers of particles lie in lanes: a record holds one particle of each cell of a group."""

from typing import Any, NamedTuple

import taichi as ti

from fracsim.lanes import entry, held, inline, matrix

# Columns of a record: offset from the lowest node [cells], volume at rest [m^3], damage, displacement [m], grad u,
# excess of strain by which thresholds rise, grip, body force a mass [m/s^2].
OFFSET, VOLUME, DAMAGE, SHIFT, GRAD, EXCESS, GRIP, FORCE, FIELDS = 0, 3, 4, 5, 8, 17, 18, 19, 22
NEVER = 1e6
"""Excess of strain of particles that gather no damage: their thresholds are then out of reach, which saves work."""
# Columns of a motion: velocity [m/s], affine velocity [1/s], and of a kept one J and the damage to come besides.
VELOCITY, AFFINE, MOTION, RATIO, NOW, KEPT = 0, 3, 12, 12, 13, 14


class LaneArrays(NamedTuple):
    """The arrays of G groups with R records; all but tables are of vectors of WIDTH."""

    rows: Any
    """See `fracsim.mpm.lanes.groups`, (G, COLUMNS) int."""
    owner: Any
    """(G,)."""
    particle: Any
    """(R, WIDTH) int."""
    record: Any
    """(R, FIELDS)."""
    motion: Any
    """Velocity and affine velocity between calls, (R, MOTION)."""
    kept: Any
    """Motion of a group's particles, their J and damage, within a substep, (threads * most slots, KEPT)."""
    pad: Any
    """See `fracsim.mpm.lanes.transfer`, (threads * PLACES,)."""


@inline
def nine(array, r, first):
    """The 3 x 3 matrix in columns `first` and following of a record."""
    return matrix([[entry(array, r, first + 3 * i + j) for j in range(3)] for i in range(3)])


@inline
def three(array, r, first):
    """The three vectors in columns `first` and following of a record."""
    return held([entry(array, r, first + k) for k in range(3)])


@ti.func
def alive(r, c: ti.template()):
    """Which lanes hold a particle that has not failed."""
    return c.particles.record[r, DAMAGE] < 1
