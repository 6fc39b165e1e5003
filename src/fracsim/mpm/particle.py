"""What one particle, or the particles of one cell, do in a substep: gather, move, gather damage, scatter.

`update_particle` does all of it for a particle whose pressure is its own. Where a cell has one pressure, `update_cell`
does it for a cell, in three stages: each particle gathers, the cell averages, each particle scatters.
"""

from collections.abc import Callable
from typing import Any

import taichi as ti

from fracsim.mpm.bspline import stencil
from fracsim.mpm.constraint import constrain, prescribed_velocity
from fracsim.mpm.context import Motion, Strain, Variant
from fracsim.mpm.damaging import freed, freed_of_cell, grown
from fracsim.mpm.dilatation import average_volume_ratio, store_motion, stored_motion
from fracsim.mpm.leapfrog import kick, projected_part
from fracsim.mpm.params import (
    ALPHA,
    CELL,
    CLAMPED,
    DAMAGED,
    DENSITY,
    DT,
    EXEMPT,
    FREE,
    GRID_FAULT,
    INV_CELL,
    LX,
    LY,
    LZ,
    MAX_SPEED,
    PROJECTED,
    RELEASED,
    ROOM,
    SPEED_FAULT,
    TURN,
    VISCOUS,
)
from fracsim.mpm.stress import degraded_stress
from fracsim.mpm.tally import add, report_fault, request_stop
from fracsim.mpm.transfer import gather, kinetic, kinetic_of_nodes, projection_loss, scatter
from fracsim.tensor import J_MIN, cofactor, deformed, volume_ratio


def whole(variant: Variant) -> Any:
    """The function `(p, gathers, scatters, step, shift, context)` that does a substep of a particle, or of a cell."""
    return update_cell if variant.cellwise else update_particle


def stages(variant: Variant) -> tuple[Callable[..., Any], ...]:
    """The same in stages: all particles must have finished one before the next begins."""
    return (gather_particle, average_cell, scatter_particle) if variant.cellwise else (update_particle,)


@ti.func
def locate(p, c: ti.template()):
    """Index in the box of the lowest of the 27 nodes around particle p, and its offset from that node [cells]."""
    x = c.particles.X[p] if ti.static(c.variant.total) else c.particles.X[p] + c.particles.U[p]
    base, f = stencil(x * c.params[INV_CELL] - ti.Vector([c.params[LX], c.params[LY], c.params[LZ]]))
    return base[0] * c.grid.sx + base[1] * c.grid.sy + base[2], f


@ti.func
def grip_of(p, c: ti.template()):
    """The grip that holds particle p: -1, +1, or 0 for none."""
    return c.particles.tag[p] % EXEMPT - FREE


@ti.func
def release_failed(p, at, f, c: ti.template()):
    """A failed particle takes its share of the nodes' energy from the grid (`total`)."""
    add(c.tally, RELEASED, c.params[DENSITY] * c.particles.volume[p] * kinetic_of_nodes(c.grid, at, f))


@ti.func
def advance(p, step, at, f, c: ti.template()):
    """Gather and advance u and F, and damage where the pressure is the particle's own.

    Returns v, the affine velocity C, F, cof F and J.
    """
    b = ti.static(c.particles)
    v, moments = gather(c.grid, c.tally.row, at, f, c.variant.real)
    C = (4 * c.params[INV_CELL]) * moments
    mass = c.params[DENSITY] * b.volume[p]
    add(c.tally, PROJECTED, -projection_loss(c.params[ALPHA]) * mass * kinetic(v, C, c.params[CELL]))
    grip = grip_of(p, c)
    velocity = v
    if ti.static(c.variant.holds_nodes):
        if grip != 0:
            if ti.static(c.variant.total):  # its nodes are held already
                velocity = prescribed_velocity(grip, v, c)
            else:
                v = constrain(grip, mass, v, c)
                velocity = v
    b.U[p] = b.U[p] + c.params[DT] * velocity
    before = deformed(b.grad_u[p])
    rate = C if ti.static(c.variant.total) else C @ before
    if ti.static(not c.variant.total):
        if b.D[p] >= 1:  # a failed particle keeps its stretch and only turns
            rate = (C - C.transpose()) @ before / 2
    b.grad_u[p] = b.grad_u[p] + c.params[DT] * rate
    F = deformed(b.grad_u[p])
    cof = cofactor(F)
    J = volume_ratio(F, cof)
    if ti.static(not c.variant.cellwise):
        now = grown(p, F, J, c)
        if now > b.D[p]:
            add(c.tally, DAMAGED, freed(p, now, (before + F) / 2, c))
            b.D[p] = now
    if c.params[DT] * c.params[DT] * C.norm_sqr() > c.params[TURN]:
        request_stop(c.tally, step)
    if not v.dot(v) < c.params[MAX_SPEED] * c.params[MAX_SPEED]:
        report_fault(c.tally, SPEED_FAULT, p, step)
        b.V[p] = v  # for the message
    return v, C, F, cof, J


@ti.func
def scatter_stress(p, at, f, motion: ti.template(), strain: ti.template(), theta, step, c: ti.template()):
    """Scatter a part of the particle's momentum, its affine part included, and the impulse of its stress."""
    b = ti.static(c.particles)
    part, dt = projected_part(step, c), kick(step, c)
    v, J = motion.v, strain.J
    d, mass = b.D[p], c.params[DENSITY] * b.volume[p]
    if J < J_MIN and d < 1:
        add(c.tally, CLAMPED, mass / mass)
    J, theta_clamped = ti.max(J, J_MIN), ti.max(theta, J_MIN)
    clamped = ti.static(Strain(strain.F, strain.cof, J))
    P, power = degraded_stress(clamped, theta_clamped, motion.C, d, c)
    if ti.static(c.variant.viscous or c.variant.total):
        add(c.tally, VISCOUS, b.volume[p] * dt * power)
    grip = grip_of(p, c)
    if ti.static(c.variant.boundary == "soft"):
        if grip != 0:
            v = constrain(grip, part * mass, v, c)
    affine = (part * mass * c.params[CELL]) * motion.C - (4 * dt * c.params[INV_CELL] * b.volume[p]) * P
    momentum = (part * mass) * v
    if ti.static(c.variant.forced):
        momentum += (mass * dt) * b.force[p]
    scatter(c.grid, at, f, momentum, affine, mass)


@ti.func
def update_particle(p, gathers, scatters, step, shift, c: ti.template()):
    """A substep of a particle whose pressure is its own."""
    b = ti.static(c.particles)
    if not ti.static(c.variant.total) or b.D[p] < 1:
        at, f = locate(p, c)
        v, C, F = b.V[p], b.C[p], deformed(b.grad_u[p])
        cof = cofactor(F)
        J = volume_ratio(F, cof)
        if gathers:
            v, C, F, cof, J = advance(p, step, at, f, c)
        stays = scatters
        motion = ti.static(Motion(v, C))
        strain = ti.static(Strain(F, cof, J))
        if ti.static(c.variant.total):
            if b.D[p] >= 1:
                stays = False
                release_failed(p, at, f, c)
            if stays:
                scatter_stress(p, at + shift, f, motion, strain, J, step, c)
        else:  # weights from the new position, whose nodes must be in use
            if not ti.abs(b.U[p] - b.anchor[p]).max() < c.params[ROOM]:
                stays = False
                report_fault(c.tally, GRID_FAULT, p, step)
            if stays:
                now, there = locate(p, c)
                scatter_stress(p, now + shift, there, motion, strain, J, step, c)
        if not stays:
            b.V[p], b.C[p] = v, C


@ti.func
def gather_particle(p, gathers, scatters, step, shift, c: ti.template()):
    """First stage of a cell: gather and advance a particle, and store its own J in theta."""
    b = ti.static(c.particles)
    if b.D[p] < 1:
        J = b.D[p]
        if gathers:
            at, f = locate(p, c)
            v, C, _F, _cof, now = advance(p, step, at, f, c)
            J = now
            store_motion(p, v, C, c)
            if not scatters:
                b.V[p], b.C[p] = v, C
        else:
            F = deformed(b.grad_u[p])
            J = volume_ratio(F, cofactor(F))
        b.theta[p] = J


@ti.func
def grow_damage(p, c: ti.template()):
    """Damage of the particles of a cell, the first of which is p, at their own J; failed ones leave the grid."""
    b = ti.static(c.particles)
    grows = False
    for q in range(p, p + b.cell_counts[p]):
        if grown(q, deformed(b.grad_u[q]), b.theta[q], c) > b.D[q]:
            grows = True
    if grows:
        add(c.tally, DAMAGED, freed_of_cell(p, c))
        for q in range(p, p + b.cell_counts[p]):
            now = grown(q, deformed(b.grad_u[q]), b.theta[q], c)
            if now >= 1 and b.D[q] < 1:
                at, f = locate(q, c)
                release_failed(q, at, f, c)
                b.V[q], b.C[q] = stored_motion(q, c)
            b.D[q] = now


@ti.func
def average_cell(p, gathers, scatters, step, shift, c: ti.template()):
    """Second stage: damage of a cell's particles by their own J, then the mean of J over the cell."""
    b = ti.static(c.particles)
    if gathers:
        grow_damage(p, c)
    average_volume_ratio(p, b.cell_counts, b.D, b.volume, b.theta)


@ti.func
def scatter_particle(p, gathers, scatters, step, shift, c: ti.template()):
    """Third stage: scatter a particle under the pressure of its cell."""
    b = ti.static(c.particles)
    if scatters and b.D[p] < 1:
        v, C = b.V[p], b.C[p]
        if gathers:
            v, C = stored_motion(p, c)
        at, f = locate(p, c)
        F = deformed(b.grad_u[p])
        cof = cofactor(F)
        J = volume_ratio(F, cof)
        motion = ti.static(Motion(v, C))
        strain = ti.static(Strain(F, cof, J))
        scatter_stress(p, at + shift, f, motion, strain, b.theta[p], step, c)


@ti.func
def update_cell(p, gathers, scatters, step, shift, c: ti.template()):
    """A substep of the particles of a cell, the first of which is p."""
    b = ti.static(c.particles)
    for q in range(p, p + b.cell_counts[p]):
        gather_particle(q, gathers, scatters, step, shift, c)
    average_cell(p, gathers, scatters, step, shift, c)
    for q in range(p, p + b.cell_counts[p]):
        scatter_particle(q, gathers, scatters, step, shift, c)
