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
    # dP/dF = 2 mu (..) + lam (K (x) K + (J - 1) dK/dF), and no eigenvalue of dK/dF is beyond 2 |F| / sqrt(3): this
    # stays true, and small, where F is crushed or inverted.
    II = (l[0] * l[1]) ** 2 + (l[0] * l[2]) ** 2 + (l[1] * l[2]) ** 2
    return 2 * mu + lam * (II + 2 / 3**0.5 * ti.abs(J - 1) * l.norm())


@ti.func
def bound_updated(l, J, mu, lam):
    return 2 * mu * (2 * l[0] ** 2 - l[0]) + 3 * lam * J * ti.max(J, ti.abs(2 * J - 1))
