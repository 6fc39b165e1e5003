"""How damage grows in a group of cells, and what that frees: `fracsim.mpm.damaging`, eight particles at a time."""

import taichi as ti

from fracsim.lanes import WIDTH, entry, held, inline, matrix, some
from fracsim.mpm.lanes.groups import AT, MERGED
from fracsim.mpm.lanes.record import AFFINE, DAMAGE, EXCESS, GRAD, MOTION, NEVER, NOW, OFFSET, VOLUME, alive, nine
from fracsim.mpm.params import CRIT, DENSITY, DT, LAM, MU, ONSET, RELEASED
from fracsim.mpm.tally import add
from fracsim.mpm.transfer import kinetic_of_nodes
from fracsim.tensor import J_MIN, deformed


@ti.func
def grown_lanes(r, F: ti.template(), J, c: ti.template()):
    """Damage of a record at F: at least what it was (`fracsim.mpm.damaging.grown`)."""
    d, excess = c.particles.record[r, DAMAGE], c.particles.record[r, EXCESS]
    onset, crit = c.params[ONSET], c.params[CRIT]
    raw = c.variant.damage.raw(F, J, onset + excess * (onset - 1), crit + excess * (crit - 1))
    return ti.select((d < 1) & (excess < NEVER), ti.max(d, raw), d)


@ti.func
def halfway_lanes(r, k, c: ti.template()):
    """F of a record in the middle of the substep that has just moved it."""
    return deformed(nine(c.particles.record, r, GRAD) - nine(c.particles.kept, k, AFFINE) * (c.params[DT] / 2))


@ti.func
def freed_lanes(q, first, slots, keep, c: ti.template()):
    """Energy [J] that growth of damage frees in each cell (`fracsim.mpm.damaging.freed_of_cell`)."""
    b = ti.static(c.particles)
    mu, lam, tiny = c.params[MU], c.params[LAM], 1e-30
    none = 0 * b.record[first, VOLUME]
    before, before_J, after, after_J, out = none, none, none, none, none
    theta = none
    for p in range(slots):
        r, k = first + p, keep + p
        d, V = b.record[r, DAMAGE], b.record[r, VOLUME]
        now = b.kept[k, NOW]
        J = halfway_lanes(r, k, c).determinant()
        before, before_J = before + (1 - d) * V, before_J + (1 - d) * V * J
        after, after_J = after + (1 - now) * V, after_J + (1 - now) * V * J
    before, before_J, after, after_J = (
        shared(q, before, c), shared(q, before_J, c), shared(q, after, c), shared(q, after_J, c))  # fmt: skip
    if ti.static(c.variant.cellwise):
        theta = ti.max(before_J / ti.max(before, tiny), J_MIN)
    then = ti.max(after_J / ti.max(after, tiny), J_MIN)
    for p in range(slots):
        r, k = first + p, keep + p
        F = halfway_lanes(r, k, c)
        if ti.static(not c.variant.cellwise):
            theta = F.determinant()
        psi = c.variant.law.psi(F, theta, mu, lam)
        out = out + (b.kept[k, NOW] - b.record[r, DAMAGE]) * b.record[r, VOLUME] * psi
    if ti.static(c.variant.cellwise):
        out = out + freed_pressure(q, after, theta, then, c)
    return out


@ti.func
def freed_pressure(q, rest, theta, then, c: ti.template()):
    """Energy [J] that a change of a cell's volume ratio from theta to then frees in the rest [m^3] of the cell."""
    mu, lam = c.params[MU], c.params[LAM]
    one, zero = 0 * rest + 1, 0 * rest
    I = matrix([[one, zero, zero], [zero, one, zero], [zero, zero, one]])
    out, ratio = zero, theta
    for k in range(2):  # a loop, so that the law is compiled once
        sign = ti.select(k == 0, 1, -1)
        out = out + (rest * c.variant.law.psi(I, ratio, mu, lam)) * sign
        ratio = then
    other = c.particles.owner[q] - ti.Vector([1.0 * l for l in ti.static(range(WIDTH))])
    return ti.select(other * other < 0.5, out, zero)  # once a cell


@ti.func
def shared(q, values, c: ti.template()):
    """The sums over the lanes of each cell, where several lanes are parts of one."""
    out = values
    if c.particles.rows[q, MERGED] != 0:
        out = _sums(c.particles.owner[q], values)
    return out


@inline
def _sums(owner, values):
    """The sum over the lanes of the same owner, in each of them."""
    owner, values = held(owner), held(values)
    parts = [ti.select(owner == entry(owner, l), entry(values, l) + 0 * values, 0 * values) for l in range(WIDTH)]
    return held(sum(parts[1:], parts[0]))


@ti.func
def set_damage(q, r, k, c: ti.template()):
    """Set the damage of a record; what fails leaves the grid with its share of the nodes' energy, and moves on."""
    b = ti.static(c.particles)
    now = b.kept[k, NOW]
    failing = (now >= 1) & alive(r, c)
    if some(failing):
        for l in range(WIDTH):
            p = b.particle[r, l]
            if p >= 0 and b.record[r, DAMAGE][l] < 1 and now[l] >= 1:
                f = ti.Vector([b.record[r, OFFSET + m][l] for m in ti.static(range(3))])
                mass = c.params[DENSITY] * b.record[r, VOLUME][l]
                add(c.tally, RELEASED, mass * kinetic_of_nodes(c.grid, b.rows[q, AT + l], f))
        for m in ti.static(range(MOTION)):
            b.motion[r, m] = ti.select(failing, b.kept[k, m], b.motion[r, m])
        b.record[r, VOLUME] = ti.select(failing, 0 * now, b.record[r, VOLUME])
    b.record[r, DAMAGE] = now
