"""Quadratic B-splines: the weights of the 3 x 3 x 3 nodes around a particle."""

import taichi as ti


@ti.func
def weights(f):
    """The three weights along one axis for a particle at f in [0.5, 1.5) cells from the lowest node."""
    return ti.Vector([(1.5 - f) ** 2 / 2, 0.75 - (f - 1) ** 2, (f - 0.5) ** 2 / 2])


@ti.func
def stencil(y):
    """Lowest node and offset [cells] of the particle at y >= 0.5 [cells from node 0]."""
    base = (y - 0.5).cast(ti.i32)
    return base, y - base
