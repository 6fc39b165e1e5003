"""From a law and damage to the stress that drives the grid."""

import taichi as ti

SHOCK = 1.5
"""Shock viscosity is a pressure of this times density (h dJ/dt)^2; 1.5 to 2 is usual."""
COMPRESSED = 0.8
"""Volume ratio below which it acts: that of a recoil, beyond what pulling an object does to it."""


@ti.func
def stiffening(F, K, J):
    """J^2 / lambda_min^2, or a little more: how much stiffer compression makes a viscosity felt at rest.

    The eigenvalues of K K^T = J^2 F^-T F^-1 sum to |K|^2 and their products in pairs to J^2 |F|^2, so that none exceeds
    q + 2 p with the usual mean q and deviation p of a symmetric 3 x 3 matrix.
    """
    II = K.norm_sqr()
    return (II + 2 * ti.sqrt(ti.max(II * II - 3 * (J * J) * F.norm_sqr(), 0))) / 3


@ti.func
def shock(rate, K, inertia, dt):
    """Pressure [Pa] that resists rate = dJ/dt < 0 [1/s], where inertia = density h^2 (`total`).

    A recoil ends in shocks, steeper than cells can show: what the jump takes from the motion would ring in single cells
    and crush them. A pressure quadratic in the jump of velocity across a cell, h dJ/dt, spreads it over a few cells and
    changes neither the states on both sides nor what is smooth (von Neumann and Richtmyer 1950). Its divisor is that of
    an implicit substep for an isolated particle: it never turns the motion round, however long the substep is.
    """
    return SHOCK * inertia * rate * rate / (1 - 4 * SHOCK * dt * rate * K.norm_sqr())


@ti.func
def force(law: ti.template(), total: ti.template(), viscous: ti.template(), F, K, J, theta, C, d, mu, lam, eta,
          eta_max, inertia, dt):  # fmt: skip
    """The stress that `scatter` needs, and the viscous power a volume; inertia = density h^2.

    (1 - d) tau is the degraded Kirchhoff stress (Eq. 5); the viscosity adds eta (L + L^T), which for the affine
    velocity C of the present configuration is RPIC damping exactly. In the rest configuration L = C F^-1, the result
    is P = tau F^-T, what is damaged is less viscous too, and eta is at most what an explicit substep can bear; in the
    present one the result is tau. In `total`, where nodes keep their velocity, what is compressed meets `shock` too.
    """
    q, power = d * 0, d * 0
    if ti.static(total):
        rate = (C * K).sum()
        if J < COMPRESSED and rate < 0:
            q = shock(rate, K, inertia, dt)
            power = -q * rate
    P = (1 - d) * law.piola(F, K, J, theta, mu, lam) - q * K
    if ti.static(not total):
        P = P @ F.transpose()
    if ti.static(viscous and total):
        JL = C @ K.transpose()
        twice_JD = JL + JL.transpose()
        s = ti.min((1 - d) * eta / (J * J), eta_max / stiffening(F, K, J))
        power += s / 2 * twice_JD.norm_sqr()
        P += s * (twice_JD @ K)
    elif ti.static(viscous):
        twice_D = C + C.transpose()
        power = eta / 2 * twice_D.norm_sqr()
        P += eta * twice_D
    return P, power
