"""What one particle does in a substep: gather, move, suffer damage, scatter."""

from functools import cache
from typing import Any, NamedTuple

import taichi as ti

from fracsim.mpm.bspline import stencil
from fracsim.mpm.damaging import damaging
from fracsim.mpm.dilatation import average, keep, kept
from fracsim.mpm.grips import hold, led
from fracsim.mpm.params import (
    ALPHA,
    CLAMPED,
    DAMAGED,
    DENSITY,
    DT,
    ETA,
    ETA_MAX,
    EXEMPT,
    FREE,
    FRESH,
    GRID_FAULT,
    LAM,
    LX,
    LY,
    LZ,
    MAX_SPEED,
    MU,
    PROJECTED,
    RELEASED,
    RH,
    ROOM,
    SPEED_FAULT,
    TURN,
    VISCOUS,
    H,
)  # fmt: skip
from fracsim.mpm.stress import force
from fracsim.mpm.tally import ask_to_halt, report_fault, tally
from fracsim.mpm.transfer import gather, kinetic, kinetic_of_nodes, projection_loss, scatter
from fracsim.registry import load
from fracsim.tensor import J_MIN, cofactor, deformed, volume_ratio


class Points(NamedTuple):
    """The arrays of N particles."""

    X: Any
    """Rest positions relative to the object's centre [m], (N,) vec3."""
    U: Any
    """Displacements [m], (N,) vec3."""
    V: Any
    """Velocities [m/s], (N,) vec3; up to date between calls, not between substeps."""
    C: Any
    """Affine velocities [1/s], (N,) mat3; as V."""
    H: Any
    """Displacement gradients F - I, (N,) mat3: what a short substep adds to F would be lost beside 1 in float32."""
    D: Any
    """Damage, (N,)."""
    volume: Any
    """Volumes at rest [m^3], (N,)."""
    tag: Any
    """Grip and exemption from damage, (N,) int."""
    anchor: Any
    """Displacements when the grid was laid [m], (N,) vec3."""
    force: Any
    """Body forces a mass [m/s^2], (N,) vec3; of length 1 where there are none."""
    many: Any
    """How many particles the cell has whose first one this is, otherwise 0, (N,) int; of length 1 unless `cellwise`."""
    theta: Any
    """Mean volume ratios of the particles' cells, (N,); as `many`."""
    wait: Any
    """Velocities of a cell's particles while they wait for its mean, (threads, a power of 2 of places) vec4."""


class Visit(NamedTuple):
    """What is done to particles in a substep."""

    whole: Any
    """All of it: for a particle, or for a cell by way of its first particle."""
    stages: tuple[Any, ...]
    """The same in stages, each of which all particles must have reached before the next one begins."""


@cache
def particle_function(
    law_name: str, damage_name: str, total: bool, cellwise: bool, viscous: bool, forced: bool, grips: str, real: Any
) -> Visit:
    """The functions for one law, one damage law, one formulation and one floating-point type.

    With `cellwise` the stress of a particle waits for the mean volume ratio of its cell (`fracsim.mpm.dilatation`).
    """
    law = load("fracsim.constitutive", law_name, "material.law")
    damages = damaging(law_name, damage_name, real)

    @ti.func
    def locate(p, K: ti.template(), b: ti.template()):
        y = b.X[p] if ti.static(total) else b.X[p] + b.U[p]
        return stencil(y * K[RH] - ti.Vector([K[LX], K[LY], K[LZ]]))

    @ti.func
    def part(step, K: ti.template()):
        """Part of the momentum that particles give to the nodes."""
        return ti.max(K[ALPHA], K[FRESH]) if step == 0 else K[ALPHA]

    @ti.func
    def leave(p, at, f, K: ti.template(), b: ti.template(), g: ti.template(), ledger: ti.template()):
        """A failed particle takes its share of the nodes' energy from the grid (`total`)."""
        tally(ledger, RELEASED, K[DENSITY] * b.volume[p] * kinetic_of_nodes(g, at, f))

    @ti.func
    def move(p, step, at, f, K: ti.template(), b: ti.template(), g: ti.template(), ledger: ti.template()):
        """Gather, advance u, F and, unless a cell waits, d; returns v, the affine velocity C, F, cof F and J."""
        v, moments = gather(g, ledger.row, at, f, real)
        C = (4 * K[RH]) * moments
        mass = K[DENSITY] * b.volume[p]
        tally(ledger, PROJECTED, -projection_loss(K[ALPHA]) * mass * kinetic(v, C, K[H]))
        grip = b.tag[p] % EXEMPT - FREE
        moves = v
        if ti.static(grips != "soft"):
            if grip != 0:
                if ti.static(total):  # its nodes are held already
                    moves = led(grip, v, K, grips)
                else:
                    v = hold(ledger, grip, mass, v, K, grips)
                    moves = v
        b.U[p] = b.U[p] + K[DT] * moves
        before = deformed(b.H[p])
        rate = C if ti.static(total) else C @ before
        if ti.static(not total):
            if b.D[p] >= 1:  # what has failed keeps its stretch and only turns
                rate = (C - C.transpose()) @ before / 2
        b.H[p] = b.H[p] + K[DT] * rate
        F = deformed(b.H[p])
        cof = cofactor(F)
        J = volume_ratio(F, cof)
        if ti.static(not cellwise):
            now = damages.grown(p, F, J, K, b)
            if now > b.D[p]:
                tally(ledger, DAMAGED, damages.freed(p, now, (before + F) / 2, K, b))
                b.D[p] = now
        if K[DT] * K[DT] * C.norm_sqr() > K[TURN]:
            ask_to_halt(ledger, step)
        if not v.dot(v) < K[MAX_SPEED] * K[MAX_SPEED]:
            report_fault(ledger, SPEED_FAULT, p, step)
            b.V[p] = v  # for the message
        return v, C, F, cof, J

    @ti.func
    def push(p, at, f, v, C, F, cof, J, theta, share, K: ti.template(), b: ti.template(), g: ti.template(),
             ledger: ti.template()):  # fmt: skip
        """Scatter a part of the momentum, also of its affine part, and the impulse of the stress."""
        d, mass = b.D[p], K[DENSITY] * b.volume[p]
        if J < J_MIN and d < 1:
            tally(ledger, CLAMPED, mass / mass)
        J, theta = ti.max(J, J_MIN), ti.max(theta, J_MIN)
        inertia = K[DENSITY] * K[H] * K[H]
        P, power = force(law, total, viscous, F, cof, J, theta, C, d, K[MU], K[LAM], K[ETA], K[ETA_MAX], inertia, K[DT])
        if ti.static(viscous or total):
            tally(ledger, VISCOUS, b.volume[p] * K[DT] * power)
        grip = b.tag[p] % EXEMPT - FREE
        if ti.static(grips == "soft"):
            if grip != 0:
                v = hold(ledger, grip, share * mass, v, K, grips)
        affine = (share * mass * K[H]) * C - (4 * K[DT] * K[RH] * b.volume[p]) * P
        momentum = (share * mass) * v
        if ti.static(forced):
            momentum += (mass * K[DT]) * b.force[p]
        scatter(g, at, f, momentum, affine, mass)

    @ti.func
    def particle(p, step, gathers, scatters, shift, K: ti.template(), b: ti.template(), g: ti.template(),
                 ledger: ti.template()):  # fmt: skip
        if not ti.static(total) or b.D[p] < 1:
            base, f = locate(p, K, b)
            at = base[0] * g.sx + base[1] * g.sy + base[2]
            v, C, F = b.V[p], b.C[p], deformed(b.H[p])
            cof = cofactor(F)
            J = volume_ratio(F, cof)
            if gathers:
                v, C, F, cof, J = move(p, step, at, f, K, b, g, ledger)
            stays = scatters
            if ti.static(total):  # a failed particle leaves the grid; its energy goes to a heading of its own
                if b.D[p] >= 1:
                    stays = False
                    leave(p, at, f, K, b, g, ledger)
                if stays:
                    push(p, at + shift, f, v, C, F, cof, J, J, part(step, K), K, b, g, ledger)
            else:  # weights from the new position, whose nodes must be in use
                if not ti.abs(b.U[p] - b.anchor[p]).max() < K[ROOM]:
                    stays = False
                    report_fault(ledger, GRID_FAULT, p, step)
                if stays:
                    now, there = locate(p, K, b)
                    at = now[0] * g.sx + now[1] * g.sy + now[2]
                    push(p, at + shift, there, v, C, F, cof, J, J, part(step, K), K, b, g, ledger)
            if not stays:
                b.V[p], b.C[p] = v, C

    @ti.func
    def take(p, step, gathers, scatters, shift, K: ti.template(), b: ti.template(), g: ti.template(),
             ledger: ti.template()):  # fmt: skip
        """Gather and move a particle of a cell, and leave its own J."""
        if b.D[p] < 1:
            J = b.D[p]
            if gathers:
                base, f = locate(p, K, b)
                v, C, _F, _K, now = move(p, step, base[0] * g.sx + base[1] * g.sy + base[2], f, K, b, g, ledger)
                J = now
                keep(p, v, C, b, g, ledger)
                if not scatters:
                    b.V[p], b.C[p] = v, C
            else:
                F = deformed(b.H[p])
                J = volume_ratio(F, cofactor(F))
            b.theta[p] = J

    @ti.func
    def suffer(p, K: ti.template(), b: ti.template(), g: ti.template(), ledger: ti.template()):
        """Let damage of a cell's particles grow; what fails leaves."""
        harmed = False
        for q in range(p, p + b.many[p]):
            if damages.grown(q, deformed(b.H[q]), b.theta[q], K, b) > b.D[q]:
                harmed = True
        if harmed:
            tally(ledger, DAMAGED, damages.freed_of_cell(p, K, b, g, ledger))
            for q in range(p, p + b.many[p]):
                now = damages.grown(q, deformed(b.H[q]), b.theta[q], K, b)
                if now >= 1 and b.D[q] < 1:
                    base, f = locate(q, K, b)
                    leave(q, base[0] * g.sx + base[1] * g.sy + base[2], f, K, b, g, ledger)
                    b.V[q], b.C[q] = kept(q, b, g, ledger)
                b.D[q] = now

    @ti.func
    def weigh(p, step, gathers, scatters, shift, K: ti.template(), b: ti.template(), g: ti.template(),
              ledger: ti.template()):  # fmt: skip
        """Turn the own J of a cell's particles, after it did its harm, into their mean."""
        if gathers:
            suffer(p, K, b, g, ledger)
        average(p, b.many, b.D, b.volume, b.theta)

    @ti.func
    def give(p, step, gathers, scatters, shift, K: ti.template(), b: ti.template(), g: ti.template(),
             ledger: ti.template()):  # fmt: skip
        """Scatter a particle of a cell under the pressure of the cell."""
        if scatters and b.D[p] < 1:
            v, C = b.V[p], b.C[p]
            if gathers:
                v, C = kept(p, b, g, ledger)
            base, f = locate(p, K, b)
            F = deformed(b.H[p])
            cof = cofactor(F)
            at = base[0] * g.sx + base[1] * g.sy + base[2] + shift
            push(p, at, f, v, C, F, cof, volume_ratio(F, cof), b.theta[p], part(step, K), K, b, g, ledger)

    @ti.func
    def cell(p, step, gathers, scatters, shift, K: ti.template(), b: ti.template(), g: ti.template(),
             ledger: ti.template()):  # fmt: skip
        for q in range(p, p + b.many[p]):
            take(q, step, gathers, scatters, shift, K, b, g, ledger)
        weigh(p, step, gathers, scatters, shift, K, b, g, ledger)
        for q in range(p, p + b.many[p]):
            give(q, step, gathers, scatters, shift, K, b, g, ledger)

    return Visit(cell, (take, weigh, give)) if cellwise else Visit(particle, (particle,))
