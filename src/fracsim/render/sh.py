"""Colour from real spherical harmonics of degree 0 to 3: order, signs and offset of 3DGS (Kerbl et al. 2023).

A Gaussian that turns by R carries its colour along: f'(d) = f(R^T d). The coefficients of f' follow from those of f by
a block-diagonal (Wigner) matrix. Here f is evaluated in the direction R^T d instead, with the same result.
"""

from functools import cache
from math import pi, sqrt
from typing import Any

import numpy as np
import taichi as ti
from taichi.lang.util import to_taichi_type

from fracsim.records import Array

C0 = sqrt(1 / (4 * pi))
C1 = sqrt(3 / (4 * pi))
C2 = sqrt(15 / (4 * pi)), sqrt(5 / (16 * pi))
C3 = sqrt(35 / (32 * pi)), sqrt(105 / (4 * pi)), sqrt(21 / (32 * pi)), sqrt(7 / (16 * pi))


@ti.func
def basis(d, k: ti.template()):
    """The first k = 1, 4, 9 or 16 functions, (k,), in the unit direction d, (3,); m = -l..l, Condon-Shortley phase."""
    x, y, z = d
    Y = ti.Vector([0 * x] * k)
    Y[0] = C0
    if ti.static(k > 1):
        Y[1], Y[2], Y[3] = -C1 * y, C1 * z, -C1 * x
    if ti.static(k > 4):
        Y[4], Y[5], Y[7] = C2[0] * x * y, -C2[0] * y * z, -C2[0] * x * z
        Y[6], Y[8] = C2[1] * (3 * z * z - 1), C2[0] / 2 * (x * x - y * y)
    if ti.static(k > 9):
        Y[9], Y[15] = -C3[0] * y * (3 * x * x - y * y), -C3[0] * x * (x * x - 3 * y * y)
        Y[10], Y[14] = C3[1] * x * y * z, C3[1] / 2 * z * (x * x - y * y)
        Y[11], Y[13] = -C3[2] * y * (5 * z * z - 1), -C3[2] * x * (5 * z * z - 1)
        Y[12] = C3[3] * z * (5 * z * z - 3)
    return Y


@cache
def evaluator(k: int, dtype: Any) -> Any:
    """The kernel of max(0, 0.5 + sum_i Y_i c_i) for k coefficients c."""

    @ti.kernel
    def evaluate(
        sh: ti.types.ndarray(dtype=ti.types.vector(3, dtype), ndim=2),  # coefficients, (N, k)
        directions: ti.types.ndarray(dtype=ti.types.vector(3, dtype), ndim=1),  # of any length, (N,)
        out: ti.types.ndarray(dtype=ti.types.vector(3, dtype), ndim=1),  # colours, (N,)
    ):
        for g in range(directions.shape[0]):
            Y = basis(directions[g].normalized(), k)
            value = ti.Vector.one(dtype, 3) / 2
            for i in ti.static(range(k)):
                value += Y[i] * sh[g, i]
            out[g] = ti.max(value, 0)

    return evaluate


def colour(sh: Array, directions: Array) -> Array:
    """Colours, (N, 3), of coefficients (N, K, 3), K = 1, 4, 9 or 16, seen along directions (N, 3) of any length.

    Directions point from the eye to the Gaussian. Colours are at least 0 and may exceed 1. Raises ValueError for
    another K. Source: Kerbl et al. 2023.
    """
    n, k = sh.shape[:2]
    if k not in (1, 4, 9, 16):
        raise ValueError(f"sh has {k} coefficients a Gaussian: give 1, 4, 9 or 16 (degree 0 to 3).")
    out = np.empty((n, 3), sh.dtype)
    evaluator(k, to_taichi_type(sh.dtype))(np.ascontiguousarray(sh), np.ascontiguousarray(directions, sh.dtype), out)
    return out
