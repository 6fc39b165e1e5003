"""What the next substeps must respect, read off all particles at once; and what a frame shows of them."""

from functools import cache
from typing import Any

import numpy as np
import taichi as ti

from fracsim.mpm.bspline import stencil
from fracsim.mpm.dilatation import refresh
from fracsim.mpm.kernels import CHUNK, types
from fracsim.mpm.params import LAM, LX, LY, LZ, MU, PEAKS, RH
from fracsim.mpm.transfer import Grid, kinetic_of_nodes
from fracsim.records import Array
from fracsim.registry import load
from fracsim.tensor import J_MIN, cofactor, deformed, principal_stretches, rotation, volume_ratio


@cache
def survey(law_name: str, total: bool, cellwise: bool, real: Any) -> Any:
    """The kernel `peaks[chunk, slot] = max over particles of` (stiffness bound, speed, rate, moved).

    Arguments: parameters, U, V, C, H = F - I, D, volume, many, theta (as `Points`), displacements at the last layout,
    start, peaks.
    """
    law = load("fracsim.constitutive", law_name, "material.law")
    Scalar, Vector, _, Matrix, Index, *_ = types(real).values()
    Peaks = ti.types.ndarray(dtype=real, ndim=2)

    @ti.func
    def stiffness(p, H: ti.template(), theta: ti.template(), K: ti.template()):
        l = principal_stretches(deformed(H[p]))
        J = ti.max(l[0] * l[1] * l[2], J_MIN)
        ratio = J
        if ti.static(cellwise):
            ratio = ti.max(theta[p], J_MIN)
        out = law.bound_updated(l, J, K[MU], K[LAM])
        if ti.static(total):
            out = law.bound_total(l, J, ratio, K[MU], K[LAM])
        return out

    @ti.kernel
    def look(K: Scalar, U: Vector, V: Vector, C: Matrix, H: Matrix, D: Scalar, volume: Scalar, many: Index,
             theta: Scalar, anchor: Vector, start: Index, peaks: Peaks):  # fmt: skip
        for q in range(peaks.shape[0] * CHUNK):
            if q % CHUNK == 0:
                c = q // CHUNK
                most = ti.Vector.zero(real, PEAKS)
                for p in range(start[c], start[c + 1]):
                    if ti.static(cellwise):
                        refresh(p, many, H, D, volume, theta)
                    if not ti.static(total) or D[p] < 1:
                        stiff = (1 - D[p]) * stiffness(p, H, theta, K)
                        moved = ti.abs(U[p] - anchor[p]).max()
                        most = ti.max(most, ti.Vector([stiff, V[p].norm(), C[p].norm(), moved]))
                for k in ti.static(range(PEAKS)):
                    peaks[c, k] = most[k]

    return look


@cache
def observe(law_name: str, total: bool, cellwise: bool, real: Any) -> Any:
    """The kernel behind a frame: for all particles tau = (1 - d) P F^T (Eqs. 3 and 5) and, as columns of `scalars`,
    the strain energy density (1 - d) psi [Pa], the largest stretch and the power density (1 - d) P : dF/dt [W/m^3].

    Arguments: mu, lam, C, H = F - I, D, tau, scalars, volume, many, theta.
    """
    law = load("fracsim.constitutive", law_name, "material.law")
    Scalar, _, _, Matrix, Index, *_ = types(real).values()
    Scalars = ti.types.ndarray(dtype=real, ndim=2)

    @ti.kernel
    def evaluate(mu: real, lam: real, C: Matrix, H: Matrix, D: Scalar, tau: Matrix, scalars: Scalars, volume: Scalar,
                 many: Index, theta: Scalar):  # fmt: skip
        if ti.static(cellwise):
            for p in range(H.shape[0]):
                refresh(p, many, H, D, volume, theta)
        for p in range(H.shape[0]):
            F = deformed(H[p])
            K = cofactor(F)
            J = ti.max(volume_ratio(F, K), J_MIN)
            ratio = J
            if ti.static(cellwise):
                ratio = ti.max(theta[p], J_MIN)
            P = (1 - D[p]) * law.piola(F, K, J, ratio, mu, lam)
            tau[p] = P @ F.transpose()
            scalars[p, 0] = (1 - D[p]) * law.psi(F, ratio, mu, lam)
            scalars[p, 1] = principal_stretches(F)[0]
            scalars[p, 2] = (P * C[p]).sum() if ti.static(total) else (tau[p] * C[p]).sum()

    return evaluate


@cache
def shares(real: Any) -> Any:
    """The kernel `share = sum w |v_i|^2 / 2` over the nodes around each particle of `total` [m^2/s^2], 0 if failed.

    Arguments: parameters, X, D, strides (sx, sy, sz), velocity, share.
    """
    Scalar, Vector, Vector4, *_ = types(real).values()

    @ti.kernel
    def evaluate(K: Scalar, X: Vector, D: Scalar, sx: ti.i32, sy: ti.i32, sz: ti.i32, velocity: Vector4, share: Scalar):
        for p in range(X.shape[0]):
            share[p] = 0
            if D[p] < 1:
                base, f = stencil(X[p] * K[RH] - ti.Vector([K[LX], K[LY], K[LZ]]))
                at = base[0] * sx + base[1] * sy + base[2]
                share[p] = kinetic_of_nodes(ti.static(Grid(sx, sy, sz, velocity, None, None, 0, False)), at, f)

    return evaluate


@cache
def _polar() -> Any:
    Matrix = types(ti.f32)["matrix"]

    @ti.kernel
    def polar(F: Matrix, R: Matrix):
        for p in range(F.shape[0]):
            R[p] = rotation(F[p], cofactor(F[p]))

    return polar


def rotations(F: Array) -> Array:
    """R of the polar decompositions F = R S, (N, 3, 3) float32."""
    R = np.empty(F.shape, np.float32)
    _polar()(np.ascontiguousarray(F, np.float32), R)
    return R
