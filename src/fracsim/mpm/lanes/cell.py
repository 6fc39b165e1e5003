"""What a group of cells does in a substep (`total`): `fracsim.mpm.particle`, WIDTH particles at a time.

A particle that has failed, or a lane without one, has damage 1 and volume 0: it moves nothing and is not moved.
"""

import taichi as ti

from fracsim.lanes import WIDTH, some, total
from fracsim.mpm.context import Strain
from fracsim.mpm.lanes.damaging import freed_lanes, grown_lanes, set_damage, shared
from fracsim.mpm.lanes.groups import AT, FIRST, HELD, SLOTS
from fracsim.mpm.lanes.record import (
    AFFINE,
    DAMAGE,
    FORCE,
    GRAD,
    GRIP,
    MOTION,
    NOW,
    OFFSET,
    RATIO,
    SHIFT,
    VELOCITY,
    VOLUME,
    alive,
    nine,
    three,
)
from fracsim.mpm.lanes.transfer import PLACES, add_to_nodes, clear_sums, fetch_nodes, gather_lanes, scatter_lanes
from fracsim.mpm.leapfrog import kick, projected_part
from fracsim.mpm.params import (
    ALPHA,
    CELL,
    CLAMPED,
    DAMAGED,
    DENSITY,
    DT,
    INV_CELL,
    MAX_SPEED,
    PROJECTED,
    SPEED,
    SPEED_FAULT,
    TURN,
    UX,
    UY,
    UZ,
    VISCOUS,
)
from fracsim.mpm.stress import degraded_stress
from fracsim.mpm.tally import add, report_fault, request_stop
from fracsim.mpm.transfer import projection_loss
from fracsim.tensor import J_MIN, cofactor, deformed, volume_ratio


@ti.func
def held(v: ti.template(), grip, c: ti.template()):
    """The velocity of a particle that moves with v in a grip, or in none (0)."""
    u = ti.static([c.params[UX], c.params[UY], c.params[UZ]])
    along = grip * c.params[SPEED]
    miss = along - (v[0] * u[0] + v[1] * u[1] + v[2] * u[2])
    sliding = ti.static(c.variant.boundary == "sliding")
    out = [v[k] + miss * u[k] if sliding else along * u[k] for k in ti.static(range(3))]
    free = grip * grip < 0.5
    return [ti.select(free, v[k], out[k]) for k in ti.static(range(3))]


@ti.func
def advance_lanes(q, r, k, c: ti.template()):
    """Gather and advance u and F of a record, and keep its motion and J.

    Returns the energy that the projection takes, |C|^2, and 1 where a speed is out of limits, else 0.
    """
    b = ti.static(c.particles)
    f, live = three(b.record, r, OFFSET), alive(r, c)
    v, moments = gather_lanes(c.tally.row * PLACES, b.pad, f)
    C = moments * (4 * c.params[INV_CELL])
    velocity = [v[m] for m in ti.static(range(3))]
    if ti.static(c.variant.holds_nodes):
        if b.rows[q, HELD] != 0:
            moved = held(v, b.record[r, GRIP], c)
            for m in ti.static(range(3)):
                velocity[m] = moved[m]
    dt = ti.select(live, c.params[DT], 0 * v[0])
    for m in ti.static(range(3)):
        b.record[r, SHIFT + m] = b.record[r, SHIFT + m] + dt * velocity[m]
    F = deformed(nine(b.record, r, GRAD) + C * dt)
    for i, j in ti.static(ti.ndrange(3, 3)):
        b.record[r, GRAD + 3 * i + j] = b.record[r, GRAD + 3 * i + j] + dt * C[i, j]
        b.kept[k, AFFINE + 3 * i + j] = C[i, j]
    for m in ti.static(range(3)):
        b.kept[k, VELOCITY + m] = v[m]
    J = volume_ratio(F, cofactor(F))
    b.kept[k, RATIO] = J
    b.kept[k, NOW] = grown_lanes(r, F, J, c)
    speed, turn = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], C.norm_sqr()
    h, limit = c.params[CELL], c.params[MAX_SPEED]
    taken = (c.params[DENSITY] / 2) * b.record[r, VOLUME] * (speed + (h * h / 4) * turn)
    fault = ti.select((speed < limit * limit) | (b.record[r, DAMAGE] >= 1), 0 * speed, 1)
    return taken, ti.select(live, turn, 0 * turn), fault


@ti.func
def gather_group(q, keep, scatters, step, c: ti.template()):
    """First stage: all particles of the cells gather and advance, and their damage grows."""
    b = ti.static(c.particles)
    first, slots = b.rows[q, FIRST], b.rows[q, SLOTS]
    at = [b.rows[q, AT + l] for l in ti.static(range(WIDTH))]
    fetch_nodes(at, c.tally.row * PLACES, b.pad, c.grid)
    none = 0 * b.record[first, VOLUME]
    taken, turn, fault, grows = none, none, none, none
    for p in range(slots):
        r, k = first + p, keep + p
        t, s, w = advance_lanes(q, r, k, c)
        taken, turn, fault = taken + t, ti.max(turn, s), ti.max(fault, w)
        grows = ti.max(grows, b.kept[k, NOW] - b.record[r, DAMAGE])
    if some(fault > 0):
        report(first, slots, keep, step, c)
    add(c.tally, PROJECTED, -projection_loss(c.params[ALPHA]) * total(taken))
    if some(grows > 0):
        add(c.tally, DAMAGED, total(freed_lanes(q, first, slots, keep, c)))
        for p in range(slots):
            set_damage(q, first + p, keep + p, c)
    if some(turn * (c.params[DT] * c.params[DT]) > c.params[TURN]):
        request_stop(c.tally, step)
    if not scatters:
        for p in range(slots):
            for m in ti.static(range(MOTION)):
                b.motion[first + p, m] = ti.select(alive(first + p, c), b.kept[keep + p, m], b.motion[first + p, m])


@ti.func
def report(first, slots, keep, step, c: ti.template()):
    """Report the first particle whose speed is out of limits, and its velocity for the message."""
    b = ti.static(c.particles)
    limit = c.params[MAX_SPEED]
    for p in range(slots):
        for l in range(WIDTH):
            v = ti.Vector([b.kept[keep + p, VELOCITY + m][l] for m in ti.static(range(3))])
            if b.particle[first + p, l] >= 0 and b.record[first + p, DAMAGE][l] < 1:
                if not v.dot(v) < limit * limit:
                    report_fault(c.tally, SPEED_FAULT, b.particle[first + p, l], step)
                    for m in ti.static(range(3)):
                        b.motion[first + p, VELOCITY + m][l] = v[m]


@ti.func
def recall_group(q, keep, c: ti.template()):
    """What the first scattering of a call needs instead of a gathering: the motion that was left, and J."""
    b = ti.static(c.particles)
    first = b.rows[q, FIRST]
    for p in range(b.rows[q, SLOTS]):
        for m in ti.static(range(MOTION)):
            b.kept[keep + p, m] = b.motion[first + p, m]
        F = deformed(nine(b.record, first + p, GRAD))
        b.kept[keep + p, RATIO] = volume_ratio(F, cofactor(F))


@ti.func
def scatter_group(q, keep, step, shift, c: ti.template()):
    """Last stage: all particles of the cells scatter, under the pressure of their cell or their own."""
    b = ti.static(c.particles)
    first, slots = b.rows[q, FIRST], b.rows[q, SLOTS]
    none = 0 * b.record[first, VOLUME]
    theta, weight, work = none, none, none
    if ti.static(c.variant.cellwise):
        for p in range(slots):
            w = (1 - b.record[first + p, DAMAGE]) * b.record[first + p, VOLUME]
            theta, weight = theta + w * b.kept[keep + p, RATIO], weight + w
        theta, weight = shared(q, theta, c), shared(q, weight, c)
        theta = ti.max(theta / ti.max(weight, 1e-30), J_MIN)
    clear_sums(c.tally.row * PLACES, b.pad)
    part, dt, h = projected_part(step, c), kick(step, c), c.params[CELL]
    for p in range(slots):
        r, k = first + p, keep + p
        F, C = deformed(nine(b.record, r, GRAD)), nine(b.kept, k, AFFINE)
        d, V, J = b.record[r, DAMAGE], b.record[r, VOLUME], b.kept[k, RATIO]
        clamped = (J < J_MIN) & (d < 1)
        if some(clamped):
            add(c.tally, CLAMPED, total(ti.select(clamped, 1 + 0 * J, 0 * J)))
        J = ti.max(J, J_MIN)
        ratio = J
        if ti.static(c.variant.cellwise):
            ratio = theta
        cof = cofactor(F)
        strain = ti.static(Strain(F, cof, J))
        P, power = degraded_stress(strain, ratio, C, d, c)
        work = work + (dt * V) * power
        mass = c.params[DENSITY] * V
        affine = C * (part * h * mass) - P * ((4 * dt * c.params[INV_CELL]) * V)
        momentum = [(part * mass) * b.kept[k, VELOCITY + m] for m in ti.static(range(3))]
        if ti.static(c.variant.forced):
            for m in ti.static(range(3)):
                momentum[m] = momentum[m] + (dt * mass) * b.record[r, FORCE + m]
        f = three(b.record, r, OFFSET)
        scatter_lanes(c.tally.row * PLACES, b.pad, f, momentum, affine, mass)
    add(c.tally, VISCOUS, total(work))
    at = [b.rows[q, AT + l] + shift for l in ti.static(range(WIDTH))]
    add_to_nodes(at, c.tally.row * PLACES, b.pad, c.grid)


@ti.func
def update_group(q, keep, gathers, scatters, step, shift, c: ti.template()):
    """A substep of the particles of WIDTH cells, unless all of them have failed."""
    b = ti.static(c.particles)
    first = b.rows[q, FIRST]
    least = b.record[first, DAMAGE]
    for p in range(1, b.rows[q, SLOTS]):
        least = ti.min(least, b.record[first + p, DAMAGE])
    if some(least < 1):
        if gathers:
            gather_group(q, keep, scatters, step, c)
        else:
            recall_group(q, keep, c)
        if scatters:
            scatter_group(q, keep, step, shift, c)
