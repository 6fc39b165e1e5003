"""Fixed corotated elasticity: tau = 2 mu (F - R) F^T + lam J (J - 1) I (Stomakhin et al. 2012)."""

import taichi as ti

from fracsim.tensor import cofactor, rotation, volumetric_bound

LANES = True
"""It computes several particles side by side (`fracsim.lanes`)."""


@ti.func
def psi(F, theta, mu, lam):
    return mu * (F - rotation(F, cofactor(F))).norm_sqr() + lam * (theta - 1) ** 2 / 2


@ti.func
def piola(F, cof, J, theta, mu, lam):
    return 2 * mu * (F - rotation(F, cof)) + (lam * (theta - 1)) * cof


@ti.func
def bound_total(l, J, theta, mu, lam):
    return 2 * mu + lam * volumetric_bound(l, J, theta - 1, 1)


@ti.func
def bound_updated(l, J, mu, lam):
    return 2 * mu * (2 * l[0] ** 2 - l[0]) + 3 * lam * J * ti.max(J, ti.abs(2 * J - 1))
