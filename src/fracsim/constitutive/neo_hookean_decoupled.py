"""Decoupled neo-Hookean elasticity: tau = mu J^(-2/3) dev(F F^T) + lam / 2 (J^2 - 1) I."""

import taichi as ti

from fracsim.mpm.tensor import J_MIN

LAM_IS_BULK_MODULUS = True
"""At small strain lam resists the change of volume alone: Hooke's law with lam - 2 mu / 3 (as in PhysGaussian)."""


@ti.func
def psi(F, mu, lam):
    J = ti.max(F.determinant(), J_MIN)
    isochoric = ti.exp(ti.log(J) * -2 / 3) * F.norm_sqr() - 3
    return mu / 2 * isochoric + lam / 4 * (J**2 - 1) - lam / 2 * ti.log(J)


@ti.func
def piola(F, K, J, mu, lam):
    m = mu * ti.exp(ti.log(J) * -2 / 3)
    return m * F + ((lam / 2 * (J**2 - 1) - m * F.norm_sqr() / 3) / J) * K


@ti.func
def bound_total(l, J, mu, lam):
    s = 1 / l[2] ** 2
    S = 1 / l[0] ** 2 + 1 / l[1] ** 2 + s
    I1 = l[0] ** 2 + l[1] ** 2 + l[2] ** 2
    shear = 1 + 4 * ti.sqrt(I1 * S) / 3 + I1 / 3 * (s + 2 * S / 3)
    return mu * ti.exp(ti.log(J) * -2 / 3) * shear + lam * (J**2 * S + ti.abs(J**2 - 1) * s / 2)


@ti.func
def bound_updated(l, J, mu, lam):
    return 4 * mu * ti.exp(ti.log(J) * -2 / 3) * l[0] ** 2 + 3 * lam * J**2
