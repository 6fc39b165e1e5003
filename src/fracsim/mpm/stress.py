"""From a law and damage to the stress that drives the grid."""

import taichi as ti

from fracsim.mpm.tensor import gram


@ti.func
def stiffening(K, J):
    """1 / lambda_min^2, or a little more: how much stiffer compression makes a viscosity felt at rest.

    The largest eigenvalue of F^-1 F^-T is at most q + 2 p (closed form of a symmetric 3 x 3 matrix).
    """
    c00, c11, c22, c01, c02, c12 = gram(K)
    q = (c00 + c11 + c22) / 3
    a, b, c = c00 - q, c11 - q, c22 - q
    p = ti.sqrt((a * a + b * b + c * c + 2 * (c01 * c01 + c02 * c02 + c12 * c12)) / 6)
    return (q + 2 * p) / (J * J)


@ti.func
def force(law: ti.template(), total: ti.template(), F, K, J, C, d, mu, lam, eta, eta_max):
    """The stress that `scatter` needs, and the viscous power a volume.

    (1 - d) tau is the degraded Kirchhoff stress (Eq. 5); the viscosity adds eta (L + L^T), which for the affine
    velocity C of the present configuration is RPIC damping exactly. In the rest configuration L = C F^-1, the result
    is P = tau F^-T, what is damaged is less viscous too, and eta is at most what an explicit substep can bear; in the
    present one the result is tau.
    """
    P = (1 - d) * law.piola(F, K, J, mu, lam)
    power = d * 0
    if ti.static(total):
        if eta > 0:
            bearable = ti.min((1 - d) * eta, eta_max / stiffening(K, J))
            L = C @ K.transpose() / J
            twice_D = L + L.transpose()
            power = bearable / 2 * twice_D.norm_sqr()
            P += (bearable / J) * (twice_D @ K)
    else:
        twice_D = C + C.transpose()
        power = eta / 2 * twice_D.norm_sqr()
        P = P @ F.transpose() + eta * twice_D
    return P, power
