"""3 x 3 tensor algebra as Taichi functions, generic in the floating-point type.

Literals are integers or exact in binary, so that the same code is right in float64 too.
"""

import math

import taichi as ti

J_MIN = 0.05
"""Volume ratio below which the stress sees J_MIN instead, and the clamp is counted."""


@ti.func
def cofactor(F):
    """K = cof F = J F^-T, column by column."""
    a = ti.Vector([F[0, 0], F[1, 0], F[2, 0]])
    b = ti.Vector([F[0, 1], F[1, 1], F[2, 1]])
    c = ti.Vector([F[0, 2], F[1, 2], F[2, 2]])
    return ti.Matrix.cols([b.cross(c), c.cross(a), a.cross(b)])


@ti.func
def volume_ratio(F, K):
    """J = det F from F and its cofactor."""
    return F[0, 0] * K[0, 0] + F[1, 0] * K[1, 0] + F[2, 0] * K[2, 0]


@ti.func
def away_from_zero(J):
    """J, but never closer to zero than 1e-6, sign kept."""
    return ti.select(J < 0, ti.min(J, -1e-6), ti.max(J, 1e-6))


@ti.func
def rotation(F, steps: ti.template()):
    """R of F = R S by Newton's iteration R <- (R + R^-T) / 2 (Higham 1986), which is quadratic.

    Four steps reach 3e-5 at a stretch of 3; where the first one shows more than that, as many are added.
    """
    K = cofactor(F)
    R = F / 2 + (1 / (2 * away_from_zero(volume_ratio(F, K)))) * K
    far = R.norm_sqr() > 5
    for _ in ti.static(range(steps - 1)):
        R = _nearer(R)
    if far:
        for _ in ti.static(range(steps)):
            R = _nearer(R)
    return R


@ti.func
def _nearer(R):
    """One step of Newton's iteration towards a rotation, for R whose singular values are at least 1."""
    K = cofactor(R)
    return R / 2 + (1 / (2 * volume_ratio(R, K))) * K


@ti.func
def gram(F):
    """The six different entries 00, 11, 22, 01, 02, 12 of F^T F."""
    a = ti.Vector([F[0, 0], F[1, 0], F[2, 0]])
    b = ti.Vector([F[0, 1], F[1, 1], F[2, 1]])
    c = ti.Vector([F[0, 2], F[1, 2], F[2, 2]])
    return a.dot(a), b.dot(b), c.dot(c), a.dot(b), a.dot(c), b.dot(c)


@ti.func
def max_stretch(F, floor):
    """The largest singular value of F where it can exceed `floor` > 0, otherwise 0.

    |F|^2 = l1^2 + l2^2 + l3^2 >= l1^2 + 2 J / l1, with equality under uniaxial tension, and this grows with l1 above
    J^(1/3): so most particles need neither F^T F nor trigonometry.
    """
    J = F.determinant()
    out = floor * 0
    if (F.norm_sqr() - floor * floor) * floor > 2 * J or J > floor * floor * floor:
        out = principal_stretches(F)[0]
    return out


@ti.func
def _angle(a, b, c, d, e, f, p):
    """A third of the angle whose cosine is det(deviator / p) / 2."""
    det = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    cosine = det / (2 * ti.max(p * p * p, 1e-30))
    return ti.acos(ti.min(ti.max(cosine, -1), 1)) / 3


@ti.func
def principal_stretches(F):
    """The singular values of F, largest first."""
    c00, c11, c22, c01, c02, c12 = gram(F)
    q = (c00 + c11 + c22) / 3
    a, b, c = c00 - q, c11 - q, c22 - q
    p = ti.sqrt((a * a + b * b + c * c + 2 * (c01 * c01 + c02 * c02 + c12 * c12)) / 6)
    angle = _angle(a, b, c, c01, c02, c12, p)
    largest = q + 2 * p * ti.cos(angle)
    least = q + 2 * p * ti.cos(angle + 2 * math.pi / 3)
    tiny = 1e-6
    return ti.Vector([ti.sqrt(largest), ti.sqrt(ti.max(3 * q - largest - least, tiny)), ti.sqrt(ti.max(least, tiny))])
