"""The substep as usually written: a dense grid over the whole domain, atomic additions, an SVD for each particle.

Updated Lagrangian MLS-MPM (Hu et al. 2018) with fixed-corotated elasticity (Stomakhin et al. 2012) and RPIC damping
(Jiang et al. 2015). The motion is that of this project's `formulation: updated` with `damping: per_substep`. It uses
Taichi fields, a sixth faster here than ndarrays. Templates are fields: x, v, C, F of shape (N,), nodes of shape
(cells, cells, cells).
"""

import numpy as np
import taichi as ti

from fracsim.bench import bar
from fracsim.records import Array
from fracsim.scene.vocab import DOMAIN

MU, LAM = bar.material("fixed_corotated").mu, bar.material("fixed_corotated").lam


@ti.func
def stencil(y):
    """Lowest node, offset from it [cells] and weights along each axis, (3,) each, of a particle at y [cells], (3,)."""
    base = ti.cast(y - 0.5, ti.i32)
    f = y - base
    return base, f, [0.5 * (1.5 - f) ** 2, 0.75 - (f - 1) ** 2, 0.5 * (f - 0.5) ** 2]


@ti.func
def kirchhoff(F):
    """tau = 2 mu (F - R) F^T + lam J (J - 1) I [Pa]."""
    U, _, V = ti.svd(F)
    R = U @ V.transpose()
    J = F.determinant()
    return 2 * MU * (F - R) @ F.transpose() + ti.Matrix.identity(ti.f32, 3) * LAM * J * (J - 1)


@ti.kernel
def clear(momentum: ti.template(), mass: ti.template()):
    """Set momentum and mass of all nodes to zero."""
    for I in ti.grouped(mass):
        momentum[I] = ti.Vector.zero(ti.f32, 3)
        mass[I] = 0


@ti.kernel
def scatter(
    dt: ti.f32, h: ti.f32,  # [s], [m]
    m: ti.f32, volume: ti.f32,  # of a particle [kg], [m^3]
    x: ti.template(), v: ti.template(),  # [m], [m/s], (N,)
    C: ti.template(), F: ti.template(),  # [1/s], [1], (N,)
    momentum: ti.template(), mass: ti.template(),  # out: [kg m/s], [kg], (cells, cells, cells)
):  # fmt: skip
    """Add momentum, mass and the impulse of the stress to the nodes (P2G); += is atomic."""
    for p in x:
        base, f, w = stencil(x[p] / h)
        damped = C[p] - bar.RPIC / 2 * (C[p] + C[p].transpose())
        affine = m * damped - (dt * volume * 4 / h**2) * kirchhoff(F[p])
        for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
            offset = ti.Vector([i, j, k])
            weight = w[i][0] * w[j][1] * w[k][2]
            momentum[base + offset] += weight * (m * v[p] + affine @ ((offset - f) * h))
            mass[base + offset] += weight * m


@ti.kernel
def accelerate(momentum: ti.template(), mass: ti.template()):
    """Turn momenta [kg m/s] into velocities [m/s], reduced by the grid's decay."""
    for I in ti.grouped(mass):
        if mass[I] > 0:
            momentum[I] = momentum[I] / mass[I] * bar.KEEP


@ti.kernel
def gather(
    dt: ti.f32, h: ti.f32,  # [s], [m]
    x: ti.template(), v: ti.template(),  # in and out: [m], [m/s], (N,)
    C: ti.template(), F: ti.template(),  # in and out: [1/s], [1], (N,)
    velocity: ti.template(),  # of nodes [m/s], (cells, cells, cells)
):  # fmt: skip
    """Update velocities, positions and deformation gradients of the particles from the nodes (G2P)."""
    for p in x:
        base, f, w = stencil(x[p] / h)
        new_v, new_C = ti.Vector.zero(ti.f32, 3), ti.Matrix.zero(ti.f32, 3, 3)
        for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
            offset = ti.Vector([i, j, k])
            weighted = w[i][0] * w[j][1] * w[k][2] * velocity[base + offset]
            new_v += weighted
            new_C += 4 / h * weighted.outer_product(offset - f)
        v[p], C[p] = new_v, new_C
        x[p] += dt * new_v
        F[p] = (ti.Matrix.identity(ti.f32, 3) + dt * new_C) @ F[p]


class Plain:
    """The particles of a bar and a dense grid over [0, 2]^3."""

    def __init__(self, X: Array, v: Array, cells: int) -> None:
        """Positions X (N, 3) [m] and velocities v (N, 3) [m/s]; `cells` along the domain."""
        self.h, n = DOMAIN / cells, len(X)
        self.x, self.v = (ti.Vector.field(3, ti.f32, n) for _ in range(2))
        self.C, self.F = (ti.Matrix.field(3, 3, ti.f32, n) for _ in range(2))
        self.momentum = ti.Vector.field(3, ti.f32, (cells,) * 3)
        self.mass = ti.field(ti.f32, (cells,) * 3)
        self.x.from_numpy(X)
        self.v.from_numpy(v)
        self.F.from_numpy(np.tile(np.eye(3, dtype=np.float32), (n, 1, 1)))

    def __len__(self) -> int:
        return int(self.x.shape[0])

    def run(self, substeps: int) -> None:
        """Advance by `substeps` of length DT."""
        volume = (self.h / 2) ** 3
        for _ in range(substeps):
            clear(self.momentum, self.mass)
            scatter(bar.DT, self.h, bar.DENSITY * volume, volume, self.x, self.v, self.C, self.F, self.momentum,
                    self.mass)  # fmt: skip
            accelerate(self.momentum, self.mass)
            gather(bar.DT, self.h, self.x, self.v, self.C, self.F, self.momentum)

    def positions(self) -> Array:
        """Present positions [m], (N, 3), in the order of X."""
        return self.x.to_numpy()
