"""Fixed corotated elasticity: tau = 2 mu (F - R) F^T + lam J (J - 1) I (Stomakhin et al. 2012)."""

import taichi as ti

from fracsim.mpm.tensor import cofactor, rotation, volume_ratio


@ti.func
def psi(F, mu, lam):
    K = cofactor(F)
    J = volume_ratio(F, K)
    return mu * (F - rotation(F, K)).norm_sqr() + lam * (J - 1) ** 2 / 2


@ti.func
def piola(F, K, J, mu, lam):
    return 2 * mu * (F - rotation(F, K)) + (lam * (J - 1)) * K


@ti.func
def bound_total(l, J, mu, lam):
    S = 1 / l[0] ** 2 + 1 / l[1] ** 2 + 1 / l[2] ** 2
    return 2 * mu + lam * J * ti.max(J, ti.abs(2 * J - 1)) * S


@ti.func
def bound_updated(l, J, mu, lam):
    return 2 * mu * (2 * l[0] ** 2 - l[0]) + 3 * lam * J * ti.max(J, ti.abs(2 * J - 1))
