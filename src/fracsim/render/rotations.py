"""Rotations of deformed Gaussians."""

import numpy as np
import taichi as ti

from fracsim.records import Array
from fracsim.tensor import cofactor, rotation

Matrices = ti.types.ndarray(dtype=ti.types.matrix(3, 3, ti.f32), ndim=1)


@ti.kernel
def polar(
    F: Matrices,  # (N,)
    R: Matrices,  # out: (N,)
):
    """R of the polar decompositions F = R S."""
    for p in range(F.shape[0]):
        R[p] = rotation(F[p], cofactor(F[p]))


def rotations(F: Array) -> Array:
    """R, (N, 3, 3) float32, of the polar decompositions F = R S of F, (N, 3, 3)."""
    R = np.empty(F.shape, np.float32)
    polar(np.ascontiguousarray(F, np.float32), R)
    return R
