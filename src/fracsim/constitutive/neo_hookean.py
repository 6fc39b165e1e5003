"""Compressible neo-Hookean elasticity: tau = mu (F F^T - I) + lam ln(J) I."""

import taichi as ti

from fracsim.mpm.tensor import J_MIN


@ti.func
def psi(F, mu, lam):
    log_J = ti.log(ti.max(F.determinant(), J_MIN))
    return mu / 2 * (F.norm_sqr() - 3) - mu * log_J + lam / 2 * log_J**2


@ti.func
def piola(F, K, J, mu, lam):
    return mu * F + ((lam * ti.log(J) - mu) / J) * K


@ti.func
def bound_total(l, J, mu, lam):
    s = 1 / l[2] ** 2
    S = 1 / l[0] ** 2 + 1 / l[1] ** 2 + s
    return mu * (1 + s) + lam * (S + s * ti.abs(ti.log(J)))


@ti.func
def bound_updated(l, J, mu, lam):
    return 2 * mu * l[0] ** 2 + 3 * lam
