"""From a law and damage to the stress that drives the grid."""

import taichi as ti


@ti.func
def force(law: ti.template(), total: ti.template(), F, K, J, C, d, mu, lam, eta):
    """The stress that `scatter` needs, and the viscous power a volume.

    (1 - d) tau is the degraded Kirchhoff stress (Eq. 5); the viscosity adds eta (L + L^T), which for the affine
    velocity C of the present configuration is RPIC damping exactly. In the rest configuration L = C F^-1 and the
    result is P = tau F^-T; in the present one it is tau.
    """
    P = (1 - d) * law.piola(F, K, J, mu, lam)
    power = d * 0
    if ti.static(total):
        if eta > 0:
            L = C @ K.transpose() / J
            twice_D = L + L.transpose()
            power = eta / 2 * twice_D.norm_sqr()
            P += (eta / J) * (twice_D @ K)
    else:
        twice_D = C + C.transpose()
        power = eta / 2 * twice_D.norm_sqr()
        P = P @ F.transpose() + eta * twice_D
    return P, power
