"""Rotations of deformed Gaussians."""

import numpy as np
import taichi as ti

from fracsim.records import Array
from fracsim.tensor import cofactor, rotation

ORTHOGONAL = 1e-3
"""Largest entry of R^T R - I that counts as rounding. The closed form divides by sums of two stretches, so that it is
wrong where two of them are small beside the largest one."""
Matrices = ti.types.ndarray(dtype=ti.types.matrix(3, 3, ti.f32), ndim=1)


@ti.kernel
def polar(
    F: Matrices,  # (N,)
    R: Matrices,  # out: (N,)
    sound: ti.types.ndarray(dtype=ti.i32, ndim=1),  # out: whether R is a rotation, (N,)
):
    """R of the polar decompositions F = R S."""
    for p in range(F.shape[0]):
        r = rotation(F[p], cofactor(F[p]))
        error = (r.transpose() @ r - ti.Matrix.identity(ti.f32, 3)).norm_sqr()
        # By its bits: fast math lets the compiler assume that no comparison meets NaN.
        sound[p] = not (ti.math.isnan(error) or ti.math.isinf(error)) and error < ORTHOGONAL**2
        R[p] = r


def rotations(F: Array) -> Array:
    """R, (N, 3, 3) float32, of the polar decompositions F = R S of F, (N, 3, 3).

    R is a rotation for every F: where F is flat, of rank 1, null or inverted the stretch of S of least size takes the
    sign of det F, and what F leaves open is one of the rotations that it allows. It is I where F is not finite.
    """
    R, sound = np.empty(F.shape, np.float32), np.empty(len(F), np.int32)
    polar(np.ascontiguousarray(F, np.float32), R, sound)
    odd = np.flatnonzero(sound == 0)
    if len(odd):
        R[odd] = _by_svd(F[odd])
    return R


def _by_svd(F: Array) -> Array:
    """R, (N, 3, 3), from singular values."""
    finite = np.isfinite(F).all(axis=(1, 2))[:, None, None]
    U, _, V = np.linalg.svd(np.where(finite, F, np.eye(3)).astype(np.float64))
    U[..., 2] *= np.sign(np.linalg.det(U @ V))[:, None]
    return np.asarray(U @ V)
