"""The mean volume ratio of the particles of a cell, which drives the pressure where `solver.pressure` is `cell`.

With a bulk modulus far above the shear modulus each particle is a constraint on the motion, and eight constraints a
cell are more than its three velocities a node can meet: the body locks and its pressure is rough. One constraint a cell
is not too many (mean dilatation, Nagtegaal et al. 1974, Simo, Taylor and Pister 1985; F-bar). The mean
theta = sum (1 - d) V J / sum (1 - d) V makes (1 - d) V (... + lam dU/dtheta cof F) the exact derivative of the energy
sum (1 - d) V (... + lam U(theta)), so that damaged particles count less, failed ones not at all, and the energy closes.
"""

import taichi as ti

from fracsim.tensor import cofactor, deformed, volume_ratio

PAGE = 256
"""Least scratch places a thread, 4 KiB in float32: threads that write to nearby addresses slow each other down."""
PLACES = 4
"""Scratch places of a particle, four numbers each. v and C need three: a power of 2 saves a division."""


@ti.func
def average_volume_ratio(p, counts: ti.template(), D: ti.template(), volume: ti.template(), theta: ti.template()):
    """Replace theta of all particles of a cell, the first of which is p, by the cell's mean; they hold their own J."""
    weight, sum = D[p] * 0, D[p] * 0
    for q in range(p, p + counts[p]):
        if D[q] < 1:
            w = (1 - D[q]) * volume[q]
            weight += w
            sum += w * theta[q]
    if weight > 0:
        for q in range(p, p + counts[p]):
            theta[q] = sum / weight


@ti.func
def refresh(p, counts: ti.template(), grad_u: ti.template(), D: ti.template(), volume: ti.template(),
            theta: ti.template()):  # fmt: skip
    """Set theta of all particles of a cell, the first of which is p, to the mean at the present grad_u = F - I."""
    for q in range(p, p + counts[p]):
        F = deformed(grad_u[q])
        theta[q] = volume_ratio(F, cofactor(F))
    average_volume_ratio(p, counts, D, volume, theta)


@ti.func
def store_motion(p, v, C, c: ti.template()):
    """Store v and C of a particle until the mean of its cell is known.

    On a CPU they overwrite those of the cell before: a trip to main memory costs as much as the stress.
    """
    if ti.static(c.grid.atomic):
        c.particles.V[p], c.particles.C[p] = v, C
    else:
        s = ti.static(c.particles.scratch)
        r, o = c.tally.row, (PLACES * p) & (s.shape[1] - 1)
        s[r, o] = c.grid.zero * s[r, o] + ti.Vector([v[0], v[1], v[2], C[0, 0]])
        s[r, o + 1] = c.grid.zero * s[r, o + 1] + ti.Vector([C[0, 1], C[0, 2], C[1, 0], C[1, 1]])
        s[r, o + 2] = c.grid.zero * s[r, o + 2] + ti.Vector([C[1, 2], C[2, 0], C[2, 1], C[2, 2]])


@ti.func
def stored_motion(p, c: ti.template()):
    """The v and C that `store_motion` has stored."""
    v, C = c.particles.V[p], c.particles.C[p]
    if ti.static(not c.grid.atomic):
        s = ti.static(c.particles.scratch)
        r, o = c.tally.row, (PLACES * p) & (s.shape[1] - 1)
        x, y, z = s[r, o], s[r, o + 1], s[r, o + 2]
        v = ti.Vector([x[0], x[1], x[2]])
        C = ti.Matrix([[x[3], y[0], y[1]], [y[2], y[3], z[0]], [z[1], z[2], z[3]]])
    return v, C
