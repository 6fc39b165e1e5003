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
"""Places of a thread at least, 4 KiB in float32: what two threads write nearer to each other they write more slowly."""
KEPT = 4
"""Places for v and C of a particle, four numbers each; one stays empty, so that a place is found without division."""


@ti.func
def average(p, many: ti.template(), D: ti.template(), volume: ti.template(), theta: ti.template()):
    """Turn theta of all particles of a cell, the first of which is p, from their own J to the cell's mean."""
    weight, sum = D[p] * 0, D[p] * 0
    for q in range(p, p + many[p]):
        if D[q] < 1:
            w = (1 - D[q]) * volume[q]
            weight += w
            sum += w * theta[q]
    if weight > 0:
        for q in range(p, p + many[p]):
            theta[q] = sum / weight


@ti.func
def refresh(p, many: ti.template(), H: ti.template(), D: ti.template(), volume: ti.template(), theta: ti.template()):
    """Give all particles of a cell, the first of which is p, the mean of what H = F - I is now."""
    for q in range(p, p + many[p]):
        F = deformed(H[q])
        theta[q] = volume_ratio(F, cofactor(F))
    average(p, many, D, volume, theta)


@ti.func
def keep(p, v, C, b: ti.template(), g: ti.template(), ledger: ti.template()):
    """Put the velocities of a particle away while its stress waits for its cell.

    On a CPU they lie where those of the cell before lay, since a way to main memory costs as much as the stress.
    """
    if ti.static(g.atomic):
        b.V[p], b.C[p] = v, C
    else:
        r, o = ledger.row, (KEPT * p) & (b.wait.shape[1] - 1)
        b.wait[r, o] = g.blank * b.wait[r, o] + ti.Vector([v[0], v[1], v[2], C[0, 0]])
        b.wait[r, o + 1] = g.blank * b.wait[r, o + 1] + ti.Vector([C[0, 1], C[0, 2], C[1, 0], C[1, 1]])
        b.wait[r, o + 2] = g.blank * b.wait[r, o + 2] + ti.Vector([C[1, 2], C[2, 0], C[2, 1], C[2, 2]])


@ti.func
def kept(p, b: ti.template(), g: ti.template(), ledger: ti.template()):
    """The velocities v and C that were put away."""
    v, C = b.V[p], b.C[p]
    if ti.static(not g.atomic):
        r, o = ledger.row, (KEPT * p) & (b.wait.shape[1] - 1)
        x, y, z = b.wait[r, o], b.wait[r, o + 1], b.wait[r, o + 2]
        v = ti.Vector([x[0], x[1], x[2]])
        C = ti.Matrix([[x[3], y[0], y[1]], [y[2], y[3], z[0]], [z[1], z[2], z[3]]])
    return v, C
