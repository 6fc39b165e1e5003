"""From a law and damage to the stress that drives the grid."""

import taichi as ti

from fracsim.lanes import some
from fracsim.mpm.params import CELL, DENSITY, DT, ETA, ETA_MAX, LAM, MU

SHOCK = 1.5
"""Shock viscosity is a pressure of this times density (h dJ/dt)^2; 1.5 to 2 is usual."""
COMPRESSED = 0.8
"""Volume ratio below which it acts: a recoil compresses more than that, a pull does not."""


@ti.func
def stiffening(F, cof, J):
    """J^2 / lambda_min^2, or a little more: how much stiffer compression makes a viscosity felt at rest.

    The eigenvalues of cof cof^T = J^2 F^-T F^-1 sum to |cof|^2 and their products in pairs to J^2 |F|^2, so that none
    exceeds q + 2 p with the usual mean q and deviation p of a symmetric 3 x 3 matrix.
    """
    II = cof.norm_sqr()
    return (II + 2 * ti.sqrt(ti.max(II * II - 3 * (J * J) * F.norm_sqr(), 0))) / 3


@ti.func
def shock(rate, cof, inertia, dt):
    """Pressure [Pa] that resists rate = dJ/dt < 0 [1/s], where inertia = density h^2 (`total`).

    A recoil ends in shocks, steeper than cells can show: what the jump takes from the motion would ring in single cells
    and crush them. A pressure quadratic in the jump of velocity across a cell, h dJ/dt, spreads it over a few cells and
    changes neither the states on both sides nor what is smooth (von Neumann and Richtmyer 1950). Its divisor is that of
    an implicit substep for an isolated particle: it never turns the motion round, however long the substep is.
    """
    return SHOCK * inertia * rate * rate / (1 - 4 * SHOCK * dt * rate * cof.norm_sqr())


@ti.func
def degraded_stress(strain: ti.template(), theta, C, d, c: ti.template()):
    """The stress that `scatter` needs [Pa], and the viscous power a volume [W/m^3], of a particle with damage d.

    (1 - d) tau is the degraded Kirchhoff stress (Eq. 5); the viscosity adds eta (L + L^T), which for the affine
    velocity C of the present configuration is RPIC damping exactly. In the rest configuration L = C F^-1, the result
    is P = tau F^-T, what is damaged is less viscous too, and eta is at most what an explicit substep can bear; in the
    present one the result is tau. In `total`, where nodes keep their velocity, what is compressed meets `shock` too.
    """
    F, cof, J = strain.F, strain.cof, strain.J
    q, power = d * 0, d * 0
    if ti.static(c.variant.total):
        rate = (C * cof).sum()
        shocked = (J < COMPRESSED) & (rate < 0)
        if some(shocked):
            slowing = ti.min(rate, 0)
            most = shock(slowing, cof, c.params[DENSITY] * c.params[CELL] * c.params[CELL], c.params[DT])
            q = ti.select(shocked, most, 0)
            power = -q * rate
    P = (1 - d) * c.variant.law.piola(F, cof, J, theta, c.params[MU], c.params[LAM]) - q * cof
    if ti.static(not c.variant.total):
        P = P @ F.transpose()
    if ti.static(c.variant.viscous and c.variant.total):
        JL = C @ cof.transpose()
        twice_JD = JL + JL.transpose()
        s = ti.min((1 - d) * c.params[ETA] / (J * J), c.params[ETA_MAX] / stiffening(F, cof, J))
        power += s / 2 * twice_JD.norm_sqr()
        P += s * (twice_JD @ cof)
    elif ti.static(c.variant.viscous):
        twice_D = C + C.transpose()
        power = c.params[ETA] / 2 * twice_D.norm_sqr()
        P += c.params[ETA] * twice_D
    return P, power
