"""3 x 3 tensor algebra as Taichi functions, generic in the floating-point type.

Literals are integers or exact in binary, so that the same code is right in float64 too.
"""

import math

import taichi as ti

J_MIN = 0.05
"""Volume ratio below which the stress sees J_MIN instead, and the clamp is counted."""


@ti.func
def deformed(H):
    """F = I + H."""
    return ti.Matrix(
        [[1 + H[0, 0], H[0, 1], H[0, 2]], [H[1, 0], 1 + H[1, 1], H[1, 2]], [H[2, 0], H[2, 1], 1 + H[2, 2]]]
    )


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
def rotation(F, K):
    """R of F = R S, where K = cof F, in closed form from the invariants of F^T F.

    i = tr S = l1 + l2 + l3 is the largest root of (i^2 - I)^2 = 8 J i + 4 II with I = |F|^2 and II = |K|^2, and
    R = di/dF. Newton's iteration comes down to it from sqrt(I + 2 sqrt(3 II)), which is never below it. An inverted F
    (J < 0) gets the rotation whose S has the smallest stretch negative, so that stress pushes it back.
    """
    I, II, J = F.norm_sqr(), K.norm_sqr(), volume_ratio(F, K)
    i = ti.sqrt(I + 2 * ti.sqrt(3 * II))
    i, last = _trace(i, I, II, J, 2)
    if last * last > 1e-9 * I:  # below a stretch of about 1.2 the error is 2e-9 by now, above it round-off after this
        i, last = _trace(i, I, II, J, 3)
    c00, c11, c22, c01, c02, c12 = gram(F)
    C = ti.Matrix([[c00, c01, c02], [c01, c11, c12], [c02, c12, c22]])
    s = 1 / _slope(i, I, J)
    return ((i * i + I) * s) * F - (2 * s) * (F @ C) + (2 * i * s) * K


@ti.func
def _trace(i, I, II, J, steps: ti.template()):
    """Steps of Newton's iteration, which is quadratic, for tr S; also returns the last step."""
    step = i * 0
    for _ in ti.static(range(steps)):
        u = i * i - I
        step = (u * u - 8 * J * i - 4 * II) / (4 * _slope(i, I, J))
        i -= step
    return i, step


@ti.func
def _slope(i, I, J):
    """2 (l1 + l2)(l2 + l3)(l3 + l1) at the root, kept from zero where R is not unique."""
    return ti.max(i * (i * i - I) - 2 * J, 1e-4 * i * i * i)


@ti.func
def gram(F):
    """The six different entries 00, 11, 22, 01, 02, 12 of F^T F."""
    a = ti.Vector([F[0, 0], F[1, 0], F[2, 0]])
    b = ti.Vector([F[0, 1], F[1, 1], F[2, 1]])
    c = ti.Vector([F[0, 2], F[1, 2], F[2, 2]])
    return a.dot(a), b.dot(b), c.dot(c), a.dot(b), a.dot(c), b.dot(c)


@ti.func
def max_stretch(F, J, floor):
    """The largest singular value of F, with J = det F, where it can exceed `floor` > 0, otherwise 0.

    |F|^2 = l1^2 + l2^2 + l3^2 >= l1^2 + 2 J / l1, with equality under uniaxial tension, and this grows with l1 above
    J^(1/3): so most particles need neither F^T F nor trigonometry.
    """
    out = floor * 0
    if (F.norm_sqr() - floor * floor) * floor > 2 * J or J > floor * floor * floor:
        out = principal_stretches(F)[0]
    return out


@ti.func
def _spectrum(m00, m11, m22, d, e, f):
    """q, p and the angle of the eigenvalues q + 2 p cos(angle + 2 pi k / 3) of the symmetric matrix with these entries
    and d, e, f at 01, 02, 12."""
    q = (m00 + m11 + m22) / 3
    a, b, c = m00 - q, m11 - q, m22 - q
    p = ti.sqrt((a * a + b * b + c * c + 2 * (d * d + e * e + f * f)) / 6)
    det = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    cosine = det / (2 * ti.max(p * p * p, 1e-30))
    return q, p, ti.acos(ti.min(ti.max(cosine, -1), 1)) / 3


@ti.func
def largest_eigenvalue(M):
    """The largest eigenvalue of a symmetric matrix."""
    q, p, angle = _spectrum(M[0, 0], M[1, 1], M[2, 2], M[0, 1], M[0, 2], M[1, 2])
    return q + 2 * p * ti.cos(angle)


@ti.func
def volumetric_bound(l, J, slope, curvature):
    """Upper bound of the largest eigenvalue of d/dF (slope cof F), where slope = dU/dtheta has this derivative by J.

    With a = 1 / l it is that of (J curvature + slope) J a a^T - slope J diag(a^2) for stretches, and |slope| l1 for
    shear. The first bound is sharp near rest; the other one, curvature |K|^2 + |slope| (l1 + l2), stays finite when l3
    goes to zero. Where theta is the mean J of a cell's particles both still hold for all of them together, since the
    square of a mean is at most the mean of the squares.
    """
    s = 1 / l[2] ** 2
    S = 1 / l[0] ** 2 + 1 / l[1] ** 2 + s
    c = ti.max(curvature, 0)
    sharp = J * (ti.max(J * c + slope, 0) * S + ti.max(-slope, 0) * s)
    K2 = (l[0] * l[1]) ** 2 + (l[0] * l[2]) ** 2 + (l[1] * l[2]) ** 2
    return ti.min(sharp, c * K2 + ti.abs(slope) * (l[0] + l[1]))


@ti.func
def principal_stretches(F):
    """The singular values of F, largest first."""
    a, b, c, d, e, f = gram(F)
    q, p, angle = _spectrum(a, b, c, d, e, f)
    largest = q + 2 * p * ti.cos(angle)
    least = q + 2 * p * ti.cos(angle + 2 * math.pi / 3)
    tiny = 1e-6
    return ti.Vector([ti.sqrt(largest), ti.sqrt(ti.max(3 * q - largest - least, tiny)), ti.sqrt(ti.max(least, tiny))])
