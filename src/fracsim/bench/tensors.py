"""Kernels of rotation and largest stretch, computed always or only where needed. F and out are (N,)."""

import taichi as ti

from fracsim.mpm.kernels import types
from fracsim.tensor import cofactor, max_stretch, principal_stretches, rotation

Matrices, Scalars = types(ti.f32)["matrix"], types(ti.f32)["scalar"]


@ti.kernel
def by_svd(F: Matrices, out: Scalars):
    """out = |F - R|^2, (N,), with R from an SVD of F, (N,)."""
    ti.loop_config(serialize=True)
    for p in range(F.shape[0]):
        U, _s, V = ti.svd(F[p])
        out[p] = (F[p] - U @ V.transpose()).norm_sqr()


@ti.kernel
def by_invariants(F: Matrices, out: Scalars):
    """out = |F - R|^2, (N,), with R of F, (N,), from invariants."""
    ti.loop_config(serialize=True)
    for p in range(F.shape[0]):
        out[p] = (F[p] - rotation(F[p], cofactor(F[p]))).norm_sqr()


@ti.kernel
def stretch_always(F: Matrices, out: Scalars):
    """out = the largest stretch, (N,), of F, (N,)."""
    ti.loop_config(serialize=True)
    for p in range(F.shape[0]):
        out[p] = principal_stretches(F[p])[0]


@ti.kernel
def stretch_near_onset(F: Matrices, out: Scalars):
    """out = the largest stretch, (N,), of F, (N,); 0 if it cannot exceed lambda_onset = 1.5."""
    ti.loop_config(serialize=True)
    for p in range(F.shape[0]):
        out[p] = max_stretch(F[p], F[p].determinant(), 1.5)
