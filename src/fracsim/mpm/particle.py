"""What one particle does in a substep: gather, move, suffer damage, scatter."""

from functools import cache
from typing import Any

import taichi as ti

from fracsim.mpm.books import report_fault, tally
from fracsim.mpm.bspline import stencil
from fracsim.mpm.grips import hold
from fracsim.mpm.params import (
    CLAMPED,
    CRIT,
    DAMAGED,
    DENSITY,
    DT,
    ETA,
    ETA_MAX,
    EXEMPT,
    FREE,
    GRID_FAULT,
    LAM,
    LX,
    LY,
    LZ,
    MAX_SPEED,
    MU,
    ONSET,
    RELEASED,
    RH,
    ROOM,
    SPEED_FAULT,
    VISCOUS,
    H,
)  # fmt: skip
from fracsim.mpm.stress import force
from fracsim.mpm.tensor import J_MIN, cofactor, volume_ratio
from fracsim.mpm.transfer import gather, scatter
from fracsim.registry import load


@cache
def particle_function(law_name: str, damage_name: str, total: bool, grips: str, atomic: bool, real: Any) -> Any:
    """The function `particle` for one law, one damage law, one formulation and one floating-point type."""
    law = load("fracsim.constitutive", law_name, "material.law")
    damage = load("fracsim.damage", damage_name, "fracture.law")

    @ti.func
    def locate(p, K: ti.template(), X: ti.template(), U: ti.template()):
        y = X[p] if ti.static(total) else X[p] + U[p]
        return stencil(y * K[RH] - ti.Vector([K[LX], K[LY], K[LZ]]))

    @ti.func
    def suffer(p, row, F_new, K: ti.template(), D: ti.template(), volume: ti.template(), books: ti.template()):
        """Damage never heals (Eq. 4); the energy it frees is booked."""
        raw = damage.raw(F_new, K[ONSET], K[CRIT])
        if raw > D[p]:
            energy = volume[p] * law.psi(F_new, K[MU], K[LAM])
            tally(books, row, DAMAGED, (raw - D[p]) * energy, atomic)
            D[p] = raw

    @ti.func
    def move(p, row, step, at, f, sx, sy, K: ti.template(), U: ti.template(), F: ti.template(), D: ti.template(),
             volume: ti.template(), tag: ti.template(), grid: ti.template(), books: ti.template(),
             faults: ti.template()):  # fmt: skip
        """Gather, advance u, F and d; returns v, the affine velocity C and F."""
        v, moments = gather(grid, at, f, sx, sy, real)
        C = (4 * K[RH]) * moments
        grip = tag[p] % EXEMPT - FREE
        if ti.static(grips != "soft"):
            if grip != 0:
                v = hold(books, row, grip, K[DENSITY] * volume[p], v, K, grips, atomic)
        U[p] = U[p] + K[DT] * v
        F_new = F[p] + K[DT] * (C if ti.static(total) else C @ F[p])
        if ti.static(not total):
            if D[p] >= 1:  # what has failed keeps its stretch and only turns
                F_new = F[p] + (K[DT] / 2) * ((C - C.transpose()) @ F[p])
        F[p] = F_new
        if tag[p] < EXEMPT and D[p] < 1:
            suffer(p, row, F_new, K, D, volume, books)
        if not v.dot(v) < K[MAX_SPEED] * K[MAX_SPEED]:
            report_fault(faults, row, SPEED_FAULT, p, step)
        return v, C, F_new

    @ti.func
    def push(p, row, at, f, sx, sy, v, C, F_p, K: ti.template(), D: ti.template(), volume: ti.template(),
             tag: ti.template(), copies: ti.template(), books: ti.template()):  # fmt: skip
        """Scatter momentum, its affine part and the impulse of the stress."""
        mass, d = K[DENSITY] * volume[p], D[p]
        cof = cofactor(F_p)
        J = volume_ratio(F_p, cof)
        if J < J_MIN and d < 1:
            tally(books, row, CLAMPED, mass / mass, atomic)
        P, power = force(law, total, F_p, cof, ti.max(J, J_MIN), C, d, K[MU], K[LAM], K[ETA], K[ETA_MAX])
        if K[ETA] > 0:
            tally(books, row, VISCOUS, volume[p] * K[DT] * power, atomic)
        grip = tag[p] % EXEMPT - FREE
        if ti.static(grips == "soft"):
            if grip != 0:
                v = hold(books, row, grip, mass, v, K, grips, atomic)
        affine = (mass * K[H]) * C - (4 * K[DT] * K[RH] * volume[p]) * P
        scatter(copies, at, f, sx, sy, mass * v, affine, mass, atomic)

    @ti.func
    def particle(p, row, step, gathers, scatters, shift, sx, sy, K: ti.template(), X: ti.template(),
                 U: ti.template(), V: ti.template(), C: ti.template(), F: ti.template(), D: ti.template(),
                 volume: ti.template(), tag: ti.template(), anchor: ti.template(), grid: ti.template(),
                 copies: ti.template(), books: ti.template(), faults: ti.template()):  # fmt: skip
        if not ti.static(total) or D[p] < 1:
            base, f = locate(p, K, X, U)
            at = base[0] * sx + base[1] * sy + base[2]
            v, C_p, F_p = V[p], C[p], F[p]
            if gathers:
                v, C_p, F_p = move(p, row, step, at, f, sx, sy, K, U, F, D, volume, tag, grid, books, faults)
            stays = scatters
            if ti.static(total):  # a failed particle leaves the grid; its energy goes to a heading of its own
                if D[p] >= 1:
                    stays = False
                    tally(books, row, RELEASED, K[DENSITY] * volume[p] * v.dot(v) / 2, atomic)
                if stays:
                    push(p, row, at + shift, f, sx, sy, v, C_p, F_p, K, D, volume, tag, copies, books)
            else:  # weights from the new position, whose nodes must be in use
                if not ti.abs(U[p] - anchor[p]).max() < K[ROOM]:
                    stays = False
                    report_fault(faults, row, GRID_FAULT, p, step)
                if stays:
                    now, g = locate(p, K, X, U)
                    to = now[0] * sx + now[1] * sy + now[2] + shift
                    push(p, row, to, g, sx, sy, v, C_p, F_p, K, D, volume, tag, copies, books)
            if not stays:
                V[p], C[p] = v, C_p

    return particle
