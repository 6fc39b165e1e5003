"""Decoupled neo-Hookean elasticity: tau = mu J^(-2/3) dev(F F^T) + lam / 2 (J^2 - 1) I."""

import taichi as ti

from fracsim.tensor import J_MIN, largest_eigenvalue, log

LANES = True
"""It computes several particles side by side (`fracsim.lanes`)."""
LAM_IS_BULK_MODULUS = True
"""At small strain lam is the bulk modulus: Hooke's law with lam - 2 mu / 3 for its lambda (as in PhysGaussian)."""


@ti.func
def psi(F, theta, mu, lam):
    isochoric = ti.exp(log(ti.max(F.determinant(), J_MIN)) * -2 / 3) * F.norm_sqr() - 3
    volume = ti.max(theta, J_MIN)
    return mu / 2 * isochoric + lam / 4 * (volume**2 - 1) - lam / 2 * log(volume)


@ti.func
def piola(F, cof, J, theta, mu, lam):
    m = mu * ti.exp(log(J) * -2 / 3)
    return m * F + (lam / 2 * (theta - 1 / theta) - m * F.norm_sqr() / 3 / J) * cof


@ti.func
def bound_total(l, J, theta, mu, lam):
    """From the Hessian of psi by l. Its largest eigenvalue is far less than the sum of a bound for the change of volume
    and one for the change of shape.
    """
    a, I = 1 / l, l.norm_sqr()
    m, slope, curvature = mu * ti.exp(log(J) * -2 / 3), (theta - 1 / theta) / 2, (1 + 1 / theta**2) / 2
    la, aa = l.outer_product(a), a.outer_product(a)
    hessian = (2 * m * I / 9 + lam * J * (J * curvature + slope)) * aa - (2 * m / 3) * (la + la.transpose())
    for k in ti.static(range(3)):
        hessian[k, k] += m + (m * I / 3 - lam * J * slope) * a[k] ** 2
    shear = m + ti.abs(m * I / 3 - lam * J * slope) * a[1] * a[2]
    return ti.max(largest_eigenvalue(hessian), shear)


@ti.func
def bound_updated(l, J, mu, lam):
    """The larger of two bounds, for the change of shape and of volume: these changes are orthogonal."""
    return ti.max(2 * mu * ti.exp(log(J) * -2 / 3) * l[0] ** 2, 3 * lam * J**2)
