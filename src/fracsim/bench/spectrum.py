"""How stiff the nodes of a body are together, measured against an isolated particle: what the substep may be (`BODY`).

With a stiffness M the velocities of the nodes obey m dv/dt = -sum_p V M G_p^T G_p u, where G_p are the moments by which
particle p sees the nodes (MLS-MPM, Hu et al. 2018). The largest eigenvalue of m^-1 sum_p V G_p^T G_p is 4 / (density
h^2) for one particle by itself. It is less for a body, whose particles share the mass of their nodes.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix, diags, vstack
from scipy.sparse.linalg import LinearOperator, eigsh

from fracsim import Scene, backend, compose, registry
from fracsim.asset.build import build_of
from fracsim.bench.record import Row
from fracsim.mpm.timestep import BODY
from fracsim.records import Array
from fracsim.solve.simulator import Simulator

ISOLATED = 4.0
"""Eigenvalue of a particle by itself [1 / (density h^2)]."""
LIGHT = 1e-6
"""Nodes with less than this part of a particle's mass are at the far end of the weights and hold nothing."""
STEP = 0.005
"""Part of the particles that fails between two looks at a tearing object."""
TOLERANCE = 5e-3
"""Relative error of an eigenvalue; many are nearly equal, and more digits take long."""
MATERIALS = ("bread", "rubber")


def study(out: Path, quick: bool) -> Iterator[Row]:
    """Built-in objects at rest and torn, at quality=preview; without `quick` the loaf also at quality=default."""
    objects = ("bread",) if quick else registry.names("fracsim.asset.objects")
    for name in objects:
        for material in MATERIALS[: 1 if quick else None]:
            yield from rows(name, compose(f"asset={name}", f"material={material}", f"fracture={material}",
                                          "quality=preview"))  # fmt: skip
    if not quick:
        yield from rows("bread", compose("asset=bread"))


def rows(name: str, scene: Scene) -> Iterator[Row]:
    """The eigenvalue of an object before the pull, and the largest that it has in a frame while it tears."""
    backend.start(scene.backend)
    simulator = Simulator(scene, build_of(scene))
    state, worst, failed = simulator.state, 0.0, 0
    what = f"{name}, {scene.material.law}, {state.n:,} particles"
    volume = state.points.volume.to_numpy()
    for frame in simulator.frames():
        y, d = state.points.X.to_numpy() / state.medium.h, state.points.D.to_numpy()
        if frame.index == 0:
            yield Row(what, "at rest", ratio(y, volume), "1", most=BODY)
        intact = d < 1
        if len(d) - intact.sum() > failed + STEP * len(d):  # failed ones have neither mass nor stiffness
            failed = len(d) - intact.sum()
            for loss in (0 * d, d):  # what is viscous, and what is elastic
                worst = max(worst, ratio(y[intact], volume[intact], loss[intact]))
    yield Row(what, "while it tears", worst, "1", most=1.0)


def ratio(y: Array, volume: Array, loss: Array | None = None) -> float:
    """Largest eigenvalue of particles at y [cells], (N, 3), of volumes (N,), over that of an isolated particle.

    `loss`, (N,), is the part of their stiffness that they have lost.
    """
    weight, moments, index = _stencils(y.astype(np.float64))
    V = volume.astype(np.float64) / volume.mean()
    mass = np.bincount(index.ravel(), (weight * V[:, None]).ravel())
    scale = np.where(mass > LIGHT, 1 / np.sqrt(np.maximum(mass, LIGHT)), 0)
    root = np.sqrt(V if loss is None else V * (1 - loss))[:, None]
    particle, shape = np.repeat(np.arange(len(y)), index.shape[1]), (len(y), len(mass))
    parts = [csr_matrix(((root * m).ravel(), (particle, index.ravel())), shape) for m in moments]
    G = vstack(parts) @ diags(scale)
    operator = LinearOperator((shape[1], shape[1]), matvec=lambda v: G.T @ (G @ v), dtype=float)
    start = np.random.default_rng(0).normal(size=shape[1])
    found = eigsh(operator, k=1, which="LA", tol=TOLERANCE, return_eigenvectors=False, v0=start)
    return float(found[0]) / ISOLATED


def _stencils(y: Array) -> tuple[Array, Array, Array]:
    """Weights (N, 27), moments 4 w (x_i - x_p) / h (3, N, 27) and numbers (N, 27) of the nodes of particles at y,
    (N, 3).
    """
    base = np.floor(y - 0.5).astype(np.int64)
    f = y - base
    w = np.stack([(1.5 - f) ** 2 / 2, 0.75 - (f - 1) ** 2, (f - 0.5) ** 2 / 2], axis=1)
    steps = np.stack(np.meshgrid(*3 * (np.arange(3),), indexing="ij"), axis=-1).reshape(-1, 3)
    weight = w[:, steps[:, 0], 0] * w[:, steps[:, 1], 1] * w[:, steps[:, 2], 2]
    moments = 4 * weight * (steps.T[:, None, :] - f.T[:, :, None])
    node = (base[:, None] + steps).reshape(-1, 3)
    _, index = np.unique(node, axis=0, return_inverse=True)
    return weight, moments, index.reshape(len(y), 27)
