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
    """R of F = R S by Newton's iteration R <- (g R + R^-T / g) / 2, the first step scaled (Higham 1986)."""
    K = cofactor(F)
    J = away_from_zero(volume_ratio(F, K))
    g = ti.sqrt(K.norm() / (ti.abs(J) * F.norm()))
    R = (g / 2) * F + (1 / (2 * g * J)) * K
    for _ in ti.static(range(steps - 1)):
        K = cofactor(R)
        R = R / 2 + (1 / (2 * away_from_zero(volume_ratio(R, K)))) * K
    return R


@ti.func
def right_cauchy_green(F):
    """The six different entries 00, 11, 22, 01, 02, 12 of F^T F."""
    a = ti.Vector([F[0, 0], F[1, 0], F[2, 0]])
    b = ti.Vector([F[0, 1], F[1, 1], F[2, 1]])
    c = ti.Vector([F[0, 2], F[1, 2], F[2, 2]])
    return a.dot(a), b.dot(b), c.dot(c), a.dot(b), a.dot(c), b.dot(c)


@ti.func
def max_stretch(F, floor):
    """The largest singular value of F where it can exceed `floor`, otherwise a lower number.

    The largest eigenvalue of F^T F is at most q + 2 p (closed form of a symmetric 3 x 3 matrix), which costs no
    trigonometry: most particles stop there.
    """
    c00, c11, c22, c01, c02, c12 = right_cauchy_green(F)
    q = (c00 + c11 + c22) / 3
    a, b, c = c00 - q, c11 - q, c22 - q
    p = ti.sqrt((a * a + b * b + c * c + 2 * (c01 * c01 + c02 * c02 + c12 * c12)) / 6)
    out = floor * 0
    if q + 2 * p > floor * floor:
        out = ti.sqrt(q + 2 * p * ti.cos(_angle(a, b, c, c01, c02, c12, p)))
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
    c00, c11, c22, c01, c02, c12 = right_cauchy_green(F)
    q = (c00 + c11 + c22) / 3
    a, b, c = c00 - q, c11 - q, c22 - q
    p = ti.sqrt((a * a + b * b + c * c + 2 * (c01 * c01 + c02 * c02 + c12 * c12)) / 6)
    angle = _angle(a, b, c, c01, c02, c12, p)
    largest = q + 2 * p * ti.cos(angle)
    least = q + 2 * p * ti.cos(angle + 2 * math.pi / 3)
    tiny = 1e-6
    return ti.Vector([ti.sqrt(largest), ti.sqrt(ti.max(3 * q - largest - least, tiny)), ti.sqrt(ti.max(least, tiny))])
