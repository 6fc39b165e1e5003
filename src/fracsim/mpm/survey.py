"""What the next substeps must respect, read off all particles at once; and what a frame shows of them."""

from functools import cache
from typing import Any

import numpy as np
import taichi as ti

from fracsim.mpm.kernels import CHUNK, types
from fracsim.mpm.params import FASTEST, LAM, MOVED, MU, PEAKS, RATE, STIFFNESS
from fracsim.mpm.tensor import J_MIN, cofactor, deformed, principal_stretches, rotation, volume_ratio
from fracsim.records import Array
from fracsim.registry import load


@cache
def survey(law_name: str, total: bool, real: Any) -> Any:
    """The kernel `peaks[chunk, slot] = max over particles of` (stiffness bound, speed, rate, moved).

    Arguments: parameters, U, V, C, H = F - I, D, displacements at the last layout, start, peaks.
    """
    law = load("fracsim.constitutive", law_name, "material.law")
    Scalar, Vector, _, Matrix, Index, _ = types(real).values()
    Peaks = ti.types.ndarray(dtype=real, ndim=2)

    @ti.func
    def inspect(p, d, K: ti.template(), U: ti.template(), V: ti.template(), C: ti.template(), H: ti.template(),
                anchor: ti.template()):  # fmt: skip
        l = principal_stretches(deformed(H[p]))
        J = ti.max(l[0] * l[1] * l[2], J_MIN)
        out = ti.Vector.zero(real, PEAKS)
        if ti.static(total):
            out[STIFFNESS] = (1 - d) * law.bound_total(l, J, K[MU], K[LAM])
        else:
            out[STIFFNESS] = (1 - d) * law.bound_updated(l, J, K[MU], K[LAM])
        out[FASTEST] = V[p].norm()
        out[RATE] = C[p].norm()
        out[MOVED] = ti.abs(U[p] - anchor[p]).max()
        return out

    @ti.kernel
    def look(K: Scalar, U: Vector, V: Vector, C: Matrix, H: Matrix, D: Scalar, anchor: Vector, start: Index,
             peaks: Peaks):  # fmt: skip
        for q in range(peaks.shape[0] * CHUNK):
            if q % CHUNK == 0:
                c = q // CHUNK
                most = ti.Vector.zero(real, PEAKS)
                for p in range(start[c], start[c + 1]):
                    if not ti.static(total) or D[p] < 1:
                        most = ti.max(most, inspect(p, D[p], K, U, V, C, H, anchor))
                for k in ti.static(range(PEAKS)):
                    peaks[c, k] = most[k]

    return look


@cache
def observe(law_name: str, real: Any) -> Any:
    """The kernel behind a frame: for all particles tau = (1 - d) P F^T (Eqs. 3 and 5) and, as columns of `scalars`,
    the strain energy density (1 - d) psi [Pa] and the largest stretch. Arguments: mu, lam, H = F - I, D, tau, scalars.
    """
    law = load("fracsim.constitutive", law_name, "material.law")
    Scalar, _, _, Matrix, _, _ = types(real).values()
    Scalars = ti.types.ndarray(dtype=real, ndim=2)

    @ti.kernel
    def evaluate(mu: real, lam: real, H: Matrix, D: Scalar, tau: Matrix, scalars: Scalars):
        for p in range(H.shape[0]):
            F = deformed(H[p])
            K = cofactor(F)
            J = ti.max(volume_ratio(F, K), J_MIN)
            tau[p] = (1 - D[p]) * (law.piola(F, K, J, mu, lam) @ F.transpose())
            scalars[p, 0] = (1 - D[p]) * law.psi(F, mu, lam)
            scalars[p, 1] = principal_stretches(F)[0]

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
