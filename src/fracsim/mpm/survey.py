"""Kernels that look at all particles: what limits the next substeps, and what a frame shows."""

from functools import cache
from types import ModuleType
from typing import Any

import taichi as ti

from fracsim.mpm.bspline import stencil
from fracsim.mpm.dilatation import refresh
from fracsim.mpm.kernels import CHUNK, types
from fracsim.mpm.params import INV_CELL, LAM, LX, LY, LZ, MU, PEAKS
from fracsim.mpm.transfer import Grid, kinetic_of_nodes, velocity_of_nodes
from fracsim.tensor import J_MIN, cofactor, deformed, principal_stretches, volume_ratio


@cache
def survey(law: ModuleType, total: bool, cellwise: bool, real: Any) -> Any:
    """The kernel of `Peaks`: maxima over the particles of each thread."""
    Scalar, Vector, _, Matrix, Index, *_ = types(real).values()
    Peaks = ti.types.ndarray(dtype=real, ndim=2)

    @ti.func
    def stiffness(p, grad_u: ti.template(), theta: ti.template(), params: ti.template()):
        l = principal_stretches(deformed(grad_u[p]))
        J = ti.max(l[0] * l[1] * l[2], J_MIN)
        ratio = J
        if ti.static(cellwise):
            ratio = ti.max(theta[p], J_MIN)
        out = law.bound_updated(l, J, params[MU], params[LAM])
        if ti.static(total):
            out = law.bound_total(l, J, ratio, params[MU], params[LAM])
        return out

    @ti.kernel
    def find(
        params: Scalar,  # (PARAMETERS,)
        U: Vector, V: Vector, C: Matrix, grad_u: Matrix, D: Scalar, volume: Scalar,  # (N,): see `ParticleArrays`
        cell_counts: Index, theta: Scalar, anchor: Vector,  # (N,)
        start: Index,  # first particle of each thread, (threads + 1,)
        peaks: Peaks,  # out: [Pa], [m/s], [1/s], [m], (threads, PEAKS)
    ):  # fmt: skip
        for q in range(peaks.shape[0] * CHUNK):
            if q % CHUNK == 0:
                t = q // CHUNK
                most = ti.Vector.zero(real, PEAKS)
                for p in range(start[t], start[t + 1]):
                    if ti.static(cellwise):
                        refresh(p, cell_counts, grad_u, D, volume, theta)
                    if not ti.static(total) or D[p] < 1:
                        stiff = (1 - D[p]) * stiffness(p, grad_u, theta, params)
                        distance = ti.abs(U[p] - anchor[p]).max()
                        most = ti.max(most, ti.Vector([stiff, V[p].norm(), C[p].norm(), distance]))
                for k in ti.static(range(PEAKS)):
                    peaks[t, k] = most[k]

    return find


@cache
def observe(law: ModuleType, total: bool, cellwise: bool, real: Any) -> Any:
    """The kernel behind a frame: stresses tau = (1 - d) P F^T (Eqs. 3 and 5) and three scalars of all particles."""
    Scalar, _, _, Matrix, Index, *_ = types(real).values()
    Scalars = ti.types.ndarray(dtype=real, ndim=2)

    @ti.kernel
    def evaluate(
        mu: real, lam: real,  # Lame parameters [Pa]
        C: Matrix, grad_u: Matrix, D: Scalar, volume: Scalar,  # (N,): see `ParticleArrays`
        cell_counts: Index, theta: Scalar,  # (N,)
        tau: Matrix,  # out: degraded Kirchhoff stress [Pa], (N,)
        scalars: Scalars,  # out: (1 - d) psi [Pa], largest stretch [1], (1 - d) P : dF/dt [W/m^3], (N, 3)
    ):  # fmt: skip
        if ti.static(cellwise):
            for p in range(grad_u.shape[0]):
                refresh(p, cell_counts, grad_u, D, volume, theta)
        for p in range(grad_u.shape[0]):
            F = deformed(grad_u[p])
            cof = cofactor(F)
            J = ti.max(volume_ratio(F, cof), J_MIN)
            ratio = J
            if ti.static(cellwise):
                ratio = ti.max(theta[p], J_MIN)
            P = (1 - D[p]) * law.piola(F, cof, J, ratio, mu, lam)
            tau[p] = P @ F.transpose()
            scalars[p, 0] = (1 - D[p]) * law.psi(F, ratio, mu, lam)
            scalars[p, 1] = principal_stretches(F)[0]
            scalars[p, 2] = (P * C[p]).sum() if ti.static(total) else (tau[p] * C[p]).sum()

    return evaluate


@cache
def node_motion(real: Any) -> Any:
    """The kernel of the nodes' kinetic energy a mass, and their velocity, around each particle of `total`."""
    Scalar, Vector, Vector4, *_ = types(real).values()

    @ti.kernel
    def evaluate(
        params: Scalar,  # (PARAMETERS,)
        X: Vector, D: Scalar,  # (N,): see `ParticleArrays`
        sx: ti.i32, sy: ti.i32, sz: ti.i32, velocity: Vector4,  # see `Grid`
        energy: Scalar,  # out: sum w |v_i|^2 / 2 [m^2/s^2], 0 if failed, (N,)
        v: Vector,  # out: sum w v_i [m/s], 0 if failed, (N,)
    ):  # fmt: skip
        grid = ti.static(Grid(sx, sy, sz, velocity, None, None, 0, False))
        for p in range(X.shape[0]):
            energy[p] = 0
            v[p] = 0 * X[p]
            if D[p] < 1:
                base, f = stencil(X[p] * params[INV_CELL] - ti.Vector([params[LX], params[LY], params[LZ]]))
                at = base[0] * sx + base[1] * sy + base[2]
                energy[p] = kinetic_of_nodes(grid, at, f)
                v[p] = velocity_of_nodes(grid, at, f)

    return evaluate
