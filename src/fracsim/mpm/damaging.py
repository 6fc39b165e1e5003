"""How damage grows, of a particle or of those of a cell together, and the energy that it frees.

Damage never heals (Eq. 4). It frees energy at the middle of a substep: half of the substep's motion goes against the
stress before it, half against the one after, so that the energy closes to second order.
"""

from functools import cache
from typing import Any, NamedTuple

import taichi as ti

from fracsim.mpm.dilatation import kept
from fracsim.mpm.params import CRIT, DT, EXEMPT, LAM, MU, ONSET
from fracsim.registry import load
from fracsim.tensor import J_MIN, deformed


class Damaging(NamedTuple):
    """The functions for one law and one damage law."""

    grown: Any
    """`grown(p, F, J, K, b)`: the damage of a particle at F, at least what it was."""
    freed: Any
    """`freed(p, now, F, K, b)`: energy [J] freed by damage `now` at F, where only the particle's own F counts."""
    freed_of_cell: Any
    """`freed_of_cell(p, K, b, g, ledger)`: the same for a cell, the first particle of which is p."""


@cache
def damaging(law_name: str, damage_name: str, real: Any) -> Damaging:
    law = load("fracsim.constitutive", law_name, "material.law")
    damage = load("fracsim.damage", damage_name, "fracture.law")

    @ti.func
    def grown(p, F, J, K: ti.template(), b: ti.template()):
        now = b.D[p]
        if b.tag[p] < EXEMPT and now < 1:
            now = ti.max(now, damage.raw(F, J, K[ONSET], K[CRIT]))
        return now

    @ti.func
    def freed(p, now, F, K: ti.template(), b: ti.template()):
        return (now - b.D[p]) * b.volume[p] * law.psi(F, F.determinant(), K[MU], K[LAM])

    @ti.func
    def freed_of_cell(p, K: ti.template(), b: ti.template(), g: ti.template(), ledger: ti.template()):
        """Those of a cell lose (d' - d) V psi(F, theta); and since what is damaged counts less in their mean theta,
        the rest of them, sum (1 - d') V, goes from U(theta) to U(theta')."""
        zero = ti.cast(0, real)
        before, after = ti.Vector([zero, zero]), ti.Vector([zero, zero])
        for q in range(p, p + b.many[p]):
            if b.D[q] < 1:
                now = grown(q, deformed(b.H[q]), b.theta[q], K, b)
                J = halfway(q, K, b, g, ledger).determinant()
                before += (1 - b.D[q]) * b.volume[q] * ti.Vector([1, J])
                after += (1 - now) * b.volume[q] * ti.Vector([1, J])
        theta, out = ti.max(before[1] / before[0], J_MIN), zero
        for q in range(p, p + b.many[p]):
            if b.D[q] < 1:
                now = grown(q, deformed(b.H[q]), b.theta[q], K, b)
                if now > b.D[q]:
                    psi = law.psi(halfway(q, K, b, g, ledger), theta, K[MU], K[LAM])
                    out += (now - b.D[q]) * b.volume[q] * psi
        if after[0] > 0:
            I = ti.Matrix.identity(real, 3)
            then = ti.max(after[1] / after[0], J_MIN)
            out += after[0] * (law.psi(I, theta, K[MU], K[LAM]) - law.psi(I, then, K[MU], K[LAM]))
        return out

    @ti.func
    def halfway(q, K: ti.template(), b: ti.template(), g: ti.template(), ledger: ti.template()):
        """F in the middle of the substep that has just moved particle q of a cell."""
        _, C = kept(q, b, g, ledger)
        return deformed(b.H[q] - (K[DT] / 2) * C)

    return Damaging(grown, freed, freed_of_cell)
