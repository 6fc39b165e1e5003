"""From a law and damage to the stress that drives the grid."""

import taichi as ti


@ti.func
def stiffening(F, K, J):
    """J^2 / lambda_min^2, or a little more: how much stiffer compression makes a viscosity felt at rest.

    The eigenvalues of K K^T = J^2 F^-T F^-1 sum to |K|^2 and their products in pairs to J^2 |F|^2, so that none exceeds
    q + 2 p with the usual mean q and deviation p of a symmetric 3 x 3 matrix.
    """
    II = K.norm_sqr()
    return (II + 2 * ti.sqrt(ti.max(II * II - 3 * (J * J) * F.norm_sqr(), 0))) / 3


@ti.func
def force(
    law: ti.template(), total: ti.template(), viscous: ti.template(), F, K, J, theta, C, d, mu, lam, eta, eta_max
):
    """The stress that `scatter` needs, and the viscous power a volume.

    (1 - d) tau is the degraded Kirchhoff stress (Eq. 5); the viscosity adds eta (L + L^T), which for the affine
    velocity C of the present configuration is RPIC damping exactly. In the rest configuration L = C F^-1, the result
    is P = tau F^-T, what is damaged is less viscous too, and eta is at most what an explicit substep can bear; in the
    present one the result is tau.
    """
    P = (1 - d) * law.piola(F, K, J, theta, mu, lam)
    if ti.static(not total):
        P = P @ F.transpose()
    power = d * 0
    if ti.static(viscous and total):
        JL = C @ K.transpose()
        twice_JD = JL + JL.transpose()
        s = ti.min((1 - d) * eta / (J * J), eta_max / stiffening(F, K, J))
        power = s / 2 * twice_JD.norm_sqr()
        P += s * (twice_JD @ K)
    elif ti.static(viscous):
        twice_D = C + C.transpose()
        power = eta / 2 * twice_D.norm_sqr()
        P += eta * twice_D
    return P, power
