"""How damage grows, of a particle or of those of a cell together, and the energy that it frees.

Damage never heals (Eq. 4). It frees energy at the middle of a substep: half of the substep's motion goes against the
stress before it, half against the one after, so that the energy closes to second order.
"""

import taichi as ti

from fracsim.mpm.dilatation import stored_motion
from fracsim.mpm.params import ABOVE, CRIT, DT, EXCESS, EXEMPT, LAM, MU, ONSET
from fracsim.tensor import J_MIN, deformed


@ti.func
def grown(p, F, J, c: ti.template()):
    """Damage of particle p at F with J = det F: at least what it was.

    Thresholds rise by the excess of strain that is due to a grip's face.
    """
    d, tag = c.particles.D[p], c.particles.tag[p]
    if tag & EXEMPT == 0 and d < 1:
        excess = ti.cast(tag // ABOVE, c.variant.real) * EXCESS
        onset, crit = c.params[ONSET], c.params[CRIT]
        d = ti.max(d, c.variant.damage.raw(F, J, onset + excess * (onset - 1), crit + excess * (crit - 1)))
    return d


@ti.func
def freed(p, d, F, c: ti.template()):
    """Energy [J] that growth to damage d frees at F, where the pressure is the particle's own."""
    psi = c.variant.law.psi(F, F.determinant(), c.params[MU], c.params[LAM])
    return (d - c.particles.D[p]) * c.particles.volume[p] * psi


@ti.func
def freed_of_cell(p, c: ti.template()):
    """Energy [J] that growth of damage frees in a cell, the first particle of which is p.

    Its particles lose (d' - d) V psi(F, theta). A damaged particle counts less in their mean theta, so that the rest
    of them, sum (1 - d') V, goes from U(theta) to U(theta').
    """
    b = ti.static(c.particles)
    zero = ti.cast(0, c.variant.real)
    before, after = ti.Vector([zero, zero]), ti.Vector([zero, zero])
    for q in range(p, p + b.cell_counts[p]):
        if b.D[q] < 1:
            now = grown(q, deformed(b.grad_u[q]), b.theta[q], c)
            J = halfway(q, c).determinant()
            before += (1 - b.D[q]) * b.volume[q] * ti.Vector([1, J])
            after += (1 - now) * b.volume[q] * ti.Vector([1, J])
    theta, out = ti.max(before[1] / before[0], J_MIN), zero
    for q in range(p, p + b.cell_counts[p]):
        if b.D[q] < 1:
            now = grown(q, deformed(b.grad_u[q]), b.theta[q], c)
            if now > b.D[q]:
                psi = c.variant.law.psi(halfway(q, c), theta, c.params[MU], c.params[LAM])
                out += (now - b.D[q]) * b.volume[q] * psi
    if after[0] > 0:
        I = ti.Matrix.identity(c.variant.real, 3)
        then = ti.max(after[1] / after[0], J_MIN)
        U = c.variant.law.psi(I, theta, c.params[MU], c.params[LAM])
        out += after[0] * (U - c.variant.law.psi(I, then, c.params[MU], c.params[LAM]))
    return out


@ti.func
def halfway(q, c: ti.template()):
    """F in the middle of the substep that has just moved particle q of a cell."""
    _, C = stored_motion(q, c)
    return deformed(c.particles.grad_u[q] - (c.params[DT] / 2) * C)
