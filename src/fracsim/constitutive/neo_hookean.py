"""Compressible neo-Hookean elasticity: tau = mu (F F^T - I) + lam ln(J) I."""

import taichi as ti

from fracsim.tensor import J_MIN, log, volumetric_bound

LANES = True
"""It computes several particles side by side (`fracsim.lanes`)."""


@ti.func
def psi(F, theta, mu, lam):
    log_J, log_theta = log(ti.max(F.determinant(), J_MIN)), log(ti.max(theta, J_MIN))
    return mu / 2 * (F.norm_sqr() - 3) - mu * log_J + lam / 2 * log_theta**2


@ti.func
def piola(F, cof, J, theta, mu, lam):
    return mu * F + (lam * log(theta) / theta - mu / J) * cof


@ti.func
def bound_total(l, J, theta, mu, lam):
    log_theta = log(theta)
    return mu * (1 + 1 / l[2] ** 2) + lam * volumetric_bound(l, J, log_theta / theta, (1 - log_theta) / theta**2)


@ti.func
def bound_updated(l, J, mu, lam):
    return 2 * mu * l[0] ** 2 + 3 * lam
