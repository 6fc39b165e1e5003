"""3 x 3 tensor algebra as Taichi functions, generic in the floating-point type.

F, cof and C are (3, 3), l and a are (3,), the rest are scalars. Literals are integers or exact in binary, so that the
same code is exact in float64 too. They also compute several particles side by side (`fracsim.lanes`).
"""

import math

import taichi as ti

from fracsim.lanes import entry, held, inline, is_lanes, matrix, some

J_MIN = 0.05
"""Smallest volume ratio that the stress sees. Smaller ratios are clamped to it, and the clamps are counted."""

LN2 = 0.693147182464599609375, -1.904654323148236e-9
"""ln 2 as a number of float32 and the rest."""


@ti.func
def deformed(grad_u):
    """F = I + grad u."""
    return matrix([
        [1 + grad_u[0, 0], grad_u[0, 1], grad_u[0, 2]],
        [grad_u[1, 0], 1 + grad_u[1, 1], grad_u[1, 2]],
        [grad_u[2, 0], grad_u[2, 1], 1 + grad_u[2, 2]],
    ])  # fmt: skip


@inline
def cofactor(F):
    """cof F = J F^-T: an entry is the determinant of what is left without its row and column, taken in a circle."""
    F = held(F)
    circle = [(1, 2), (2, 0), (0, 1)]
    return matrix([[entry(F, a, c) * entry(F, b, d) - entry(F, a, d) * entry(F, b, c) for c, d in circle]
                   for a, b in circle])  # fmt: skip


@ti.func
def volume_ratio(F, cof):
    """J = det F from F and its cofactor."""
    return F[0, 0] * cof[0, 0] + F[1, 0] * cof[1, 0] + F[2, 0] * cof[2, 0]


@ti.func
def rotation(F, cof):
    """R of F = R S from the invariants of F^T F, with cof = cof F.

    i = tr S = l1 + l2 + l3 is the largest root of (i^2 - I)^2 = 8 J i + 4 II with I = |F|^2 and II = |cof F|^2, and
    R = di/dF. Newton's iteration starts at sqrt(I + 2 sqrt(3 II)) >= i and descends to i. For an inverted F (J < 0)
    the smallest stretch of S is negative, so that the stress pushes F back.
    """
    I, II, J = F.norm_sqr(), cof.norm_sqr(), volume_ratio(F, cof)
    i = ti.sqrt(I + 2 * ti.sqrt(3 * II))
    i, last = _trace(i, I, II, J, 2)
    # Two steps suffice up to a stretch of about 1.2 (error 2e-9), five everywhere (round-off).
    if some(last * last > 1e-9 * I):
        i, last = _trace(i, I, II, J, 3)
    c00, c11, c22, c01, c02, c12 = gram(F)
    C = matrix([[c00, c01, c02], [c01, c11, c12], [c02, c12, c22]])
    s = 1 / _slope(i, I, J)
    return ((i * i + I) * s) * F - (2 * s) * (F @ C) + (2 * i * s) * cof


@ti.func
def _trace(i, I, II, J, steps: ti.template()):
    """tr S after `steps` of Newton's iteration, and the last step."""
    step = i * 0
    for _ in ti.static(range(steps)):
        u = i * i - I
        step = (u * u - 8 * J * i - 4 * II) / (4 * _slope(i, I, J))
        i -= step
    return i, step


@ti.func
def _slope(i, I, J):
    """2 (l1 + l2)(l2 + l3)(l3 + l1) at the root, bounded away from zero where R is not unique."""
    return ti.max(i * (i * i - I) - 2 * J, 1e-4 * i * i * i)


@inline
def gram(F):
    """The six distinct entries 00, 11, 22, 01, 02, 12 of F^T F."""
    F = held(F)
    columns = [[entry(F, k, i) for k in range(3)] for i in range(3)]
    pairs = [(columns[i], columns[j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return held([a[0] * b[0] + a[1] * b[1] + a[2] * b[2] for a, b in pairs])


@ti.func
def max_stretch(F, J, floor):
    """The largest singular value l1 of F where it can exceed `floor` > 0, elsewhere 0; J = det F.

    |F|^2 = l1^2 + l2^2 + l3^2 >= l1^2 + 2 J / l1, with equality under uniaxial tension. The bound grows with l1 above
    J^(1/3), so that most particles need neither F^T F nor trigonometry.
    """
    out = floor * 0
    if some(((F.norm_sqr() - floor * floor) * floor > 2 * J) | (J > floor * floor * floor)):
        out = largest_stretch(F)
    return out


@ti.func
def largest_stretch(F):
    """The largest singular value of F."""
    a, b, c, d, e, f = gram(F)
    q, p, angle = _spectrum(a, b, c, d, e, f)
    return ti.sqrt(q + 2 * p * ti.cos(angle))


@ti.func
def _spectrum(m00, m11, m22, d, e, f):
    """q, p and angle of the eigenvalues q + 2 p cos(angle + 2 pi k / 3), k = 0, 1, 2, of a symmetric matrix.

    Its diagonal is m00, m11, m22; its entries 01, 02, 12 are d, e, f.
    """
    q = (m00 + m11 + m22) / 3
    a, b, c = m00 - q, m11 - q, m22 - q
    p = ti.sqrt((a * a + b * b + c * c + 2 * (d * d + e * e + f * f)) / 6)
    det = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    cosine = det / (2 * ti.max(p * p * p, 1e-30))
    return q, p, ti.acos(ti.min(ti.max(cosine, -1), 1)) / 3


@ti.func
def largest_eigenvalue(M):
    """The largest eigenvalue of a symmetric matrix M, (3, 3)."""
    q, p, angle = _spectrum(M[0, 0], M[1, 1], M[2, 2], M[0, 1], M[0, 2], M[1, 2])
    return q + 2 * p * ti.cos(angle)


@ti.func
def volumetric_bound(l, J, slope, curvature):
    """Upper bound of the largest eigenvalue of d/dF (slope cof F), with slope = U'(J) and curvature = U''(J).

    Let a = 1 / l. Under changes of the stretches the eigenvalue is that of (J curvature + slope) J a a^T - slope J
    diag(a^2), under shear |slope| l1. The first bound is sharp near rest. The second, curvature |cof F|^2 + |slope|
    (l1 + l2), stays finite when l3 goes to zero. If theta is the mean J of a cell's particles, both hold for these
    particles together, since the square of a mean is at most the mean of the squares.
    """
    s = 1 / l[2] ** 2
    S = 1 / l[0] ** 2 + 1 / l[1] ** 2 + s
    c = ti.max(curvature, 0)
    sharp = J * (ti.max(J * c + slope, 0) * S + ti.max(-slope, 0) * s)
    cof_sqr = (l[0] * l[1]) ** 2 + (l[0] * l[2]) ** 2 + (l[1] * l[2]) ** 2
    return ti.min(sharp, c * cof_sqr + ti.abs(slope) * (l[0] + l[1]))


@ti.func
def log(x):
    """ln x; of lanes in registers, for x in [2^-16, 2^16], instead of by a call a lane."""
    out = x * 0
    if ti.static(is_lanes(x)):
        out = _log_of_lanes(x)
    else:
        out = ti.log(x)
    return out


@ti.func
def _log_of_lanes(x):
    """ln x = k ln 2 + 2 artanh((y - 1) / (y + 1)) with x = 2^k y and y in [1 / sqrt 2, sqrt 2], where the 11 terms of
    the series that are taken leave out 2e-18.
    """
    one, y, k = x * 0 + 1, x, x * 0
    for n in ti.static((8, 4, 2, 1)):
        y, k = _halved(y, k, y >= 2**n, n)
        y, k = _halved(y, k, y < 0.5**n, -n)
    y, k = _halved(y, k, y > 1.4140625, 1)
    y, k = _halved(y, k, y < 0.70703125, -1)
    s = (y - 1) / (y + 1)
    square, series = s * s, one / 21
    for n in ti.static(range(19, 0, -2)):
        series = series * square + one / n
    return k * LN2[0] + (2 * s * series + k * LN2[1])


@ti.func
def _halved(y, k, here, n: ti.template()):
    """y / 2^n and k + n in these lanes."""
    return ti.select(here, y * 0.5**n, y), ti.select(here, k + n, k)


@ti.func
def principal_stretches(F):
    """The singular values of F, (3,), largest first."""
    a, b, c, d, e, f = gram(F)
    q, p, angle = _spectrum(a, b, c, d, e, f)
    largest = q + 2 * p * ti.cos(angle)
    least = q + 2 * p * ti.cos(angle + 2 * math.pi / 3)
    tiny = 1e-6
    return ti.Vector([ti.sqrt(largest), ti.sqrt(ti.max(3 * q - largest - least, tiny)), ti.sqrt(ti.max(least, tiny))])
