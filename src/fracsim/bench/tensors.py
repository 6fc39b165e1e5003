"""Kernels that compute the rotation and the largest stretch of particles always, or only where it is needed."""

import taichi as ti

from fracsim.mpm.kernels import types
from fracsim.tensor import cofactor, max_stretch, principal_stretches, rotation

Matrices, Scalars = types(ti.f32)["matrix"], types(ti.f32)["scalar"]


@ti.kernel
def by_svd(F: Matrices, out: Scalars):
    """|F - R|^2 with R from an SVD."""
    ti.loop_config(serialize=True)
    for p in range(F.shape[0]):
        U, _s, V = ti.svd(F[p])
        out[p] = (F[p] - U @ V.transpose()).norm_sqr()


@ti.kernel
def by_invariants(F: Matrices, out: Scalars):
    """|F - R|^2 with R in closed form."""
    ti.loop_config(serialize=True)
    for p in range(F.shape[0]):
        out[p] = (F[p] - rotation(F[p], cofactor(F[p]))).norm_sqr()


@ti.kernel
def stretch_always(F: Matrices, out: Scalars):
    """The largest stretch of each particle."""
    ti.loop_config(serialize=True)
    for p in range(F.shape[0]):
        out[p] = principal_stretches(F[p])[0]


@ti.kernel
def stretch_near_onset(F: Matrices, out: Scalars):
    """The largest stretch where it can be beyond lambda_onset."""
    ti.loop_config(serialize=True)
    for p in range(F.shape[0]):
        out[p] = max_stretch(F[p], F[p].determinant(), 1.5)
