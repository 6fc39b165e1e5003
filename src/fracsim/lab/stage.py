"""Bodies on a lattice for verification and tests: free or clamped, under body forces, with ghosts and mirrors."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from fracsim.mpm import params as slot
from fracsim.mpm.boundary import Clamp, Free
from fracsim.mpm.drive import Drive
from fracsim.mpm.energy import kinetic_of_particles, masses
from fracsim.mpm.layout import order
from fracsim.mpm.medium import Medium
from fracsim.mpm.state import State
from fracsim.mpm.timestep import limit, rest_stiffness
from fracsim.records import Array, Particles
from fracsim.scene.vocab import CENTRE, Fracture, Material, Solver
from fracsim.solve.march import Hook, March

CRUSHED = 0.02
"""A stable substep this small a part of that at rest means that the material is crushed or has blown up."""
NEVER = Fracture(onset=9, crit=10)
"""Thresholds that no problem without damage reaches."""


def lattice(size: tuple[float, float, float], spacing: float, centre: tuple[float, float, float] = CENTRE) -> Array:
    """Cell-centred lattice points of a box, (N, 3) float32."""
    counts = [max(1, round(s / spacing)) for s in size]
    axes = [c + spacing * (np.arange(n) - (n - 1) / 2) for c, n in zip(centre, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3).astype(np.float32)


def particles(X: Array, spacing: float, depth: float | None = None) -> Particles:
    """Grey particles of equal volume at X [m], (N, 3); in a plane problem each stands for `depth` [m] along z."""
    n, volume = len(X), spacing**3 if depth is None else spacing**2 * depth
    covariance = np.tile(0.36 * spacing**2 * np.array([1, 0, 0, 1, 0, 1], np.float32), (n, 1))
    return Particles(
        X=X.astype(np.float32),
        volume=np.full(n, volume, np.float32),
        covariance=covariance,
        opacity=np.full(n, 0.95, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
        surface=np.zeros(n, bool),
        spacing=spacing,
    )


def ordered(X: Array, h: float) -> Array:
    """Points X [m], (N, 3), in the order of memory."""
    return X[order((X - np.asarray(CENTRE)) / h)]


def bar(solver: Solver, size: tuple[float, float, float] = (0.6, 0.2, 0.2)) -> Particles:
    """A bar along x, filled at the solver's spacing."""
    return particles(ordered(lattice(size, solver.spacing), solver.h), solver.spacing)


def turned(body: Particles, degrees: float) -> Particles:
    """A body turned about z through the centre."""
    a = math.radians(degrees)
    turn = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    return replace(body, X=(CENTRE + (body.X - np.asarray(CENTRE)) @ turn.T).astype(np.float32))


def medium(
    solver: Solver,
    material: Material,
    fracture: Fracture = NEVER,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Medium:
    """A medium that does not tear unless thresholds are given; gravity in m/s^2."""
    return Medium(material, fracture, solver, gravity)


def free(medium: Medium, body: Particles) -> State:
    """A body at rest that nothing holds; body forces are `put(state, force=...)` [m/s^2] and stay until the next."""
    return State(medium, body, Free(), Drive("serial"), forced=True)


def clamped(medium: Medium, body: Particles, wall: float) -> State:
    """A body at rest, held at x <= -wall [m from the centre]; body forces as in `free`."""
    assert body.X[:, 0].max() - CENTRE[0] < wall - 3 * medium.h
    return State(medium, body, Clamp(wall=wall), Drive("serial"), forced=True)


def row(solver: Solver, material: Material, x: Array) -> State:
    """One row of particles at x [m from the centre], (N,), two a cell; `flat(state, (1, 2))` keeps it straight."""
    X = 1 + x[:, None] * [1, 0, 0]
    return free(medium(solver, material), particles(X, solver.spacing))


def put(state: State, **values: ArrayLike) -> None:
    """Set arrays of the particles: `put(state, V=..., F=...)`; one row stands for all particles."""
    for name, value in values.items():
        array = getattr(state.points, name)
        shape = array.to_numpy().shape
        array.from_numpy(np.ascontiguousarray(np.broadcast_to(value, shape).astype(state.dtype)))


def slow(state: State, keep: float) -> None:
    """Scale the velocities of particles and nodes by `keep`."""
    put(state, V=keep * state.points.V.to_numpy())
    nodes = state.grid.velocity.to_numpy()
    nodes[:, :3] *= keep
    state.grid.velocity.from_numpy(nodes)


def advance(state: State, duration: float, t: float = 0.0, before: Hook | None = None) -> int:
    """Substeps from t to t + duration [s]; returns their number.

    `before` is called before each of them. Raises RuntimeError when a particle leaves the solver's limits.
    """
    march, count, at_rest = March(state), 0, limit(state.medium, rest_stiffness(state.medium), 0.0, 0.0)
    for done in march.rounds(t, duration, before):
        kind, p, _ = state.fault()
        if kind != slot.NO_FAULT:
            raise RuntimeError(f"particle {p} {'flew too fast' if kind == slot.SPEED_FAULT else 'left the grid'}")
        if isinstance(state.medium.solver.dt, str) and not march.dt > CRUSHED * at_rest:
            raise RuntimeError("the material is crushed or has blown up: the stable substep has collapsed")
        count += done.n
    return count


def flat(state: State, axes: tuple[int, ...]) -> Hook:
    """A hook that removes motion and strain along `axes`.

    With one layer of particles there, the problem is plane or confined: fields that do not vary along an axis have
    exact weights along it, so the layer stands for an endless one.
    """
    rest = np.eye(3, dtype=state.dtype)

    def flatten(t: float, dt: float) -> None:
        for name in ("U", "V", "C", "F"):
            array = getattr(state.points, name)
            values = array.to_numpy()
            for k in axes:
                values[:, k] = rest[k] if name == "F" else 0
                if values.ndim == 3:
                    values[:, :, k] = rest[k] if name == "F" else 0
            array.from_numpy(values)
        nodes = state.grid.velocity.to_numpy()
        nodes[:, list(axes)] = 0
        state.grid.velocity.from_numpy(nodes)

    return flatten


class Ghosts:
    """Particles that copy others before each substep.

    `ghost`, (G,), copies `image`, (G,); the motion along an axis is mirrored where `sign`, (G, 3), is -1.
    """

    def __init__(self, ghost: Array, image: Array, sign: Array) -> None:
        self.ghost, self.image, self.sign = ghost, image, sign

    def __call__(self, state: State) -> None:
        """Copy the present motion to the ghosts."""
        for name in ("U", "V", "C", "F"):
            array = getattr(state.points, name)
            values = array.to_numpy()
            copy = values[self.image] * self.sign.reshape(len(self.sign), *([3] + [1] * (values.ndim - 2)))
            values[self.ghost] = copy * self.sign[:, None, :] if values.ndim == 3 else copy
            array.from_numpy(values.astype(state.dtype))


def momentum(state: State) -> Array:
    """Total linear momentum [kg m/s], (3,)."""
    return np.asarray((masses(state)[:, None] * state.points.V.to_numpy()).sum(axis=0))


def angular_momentum(state: State) -> Array:
    """Total angular momentum about the object's centre, the spin of the affine motion included [kg m^2/s], (3,).

    Over the nodes of a quadratic B-spline sum w (x_i - x_p)(x_i - x_p)^T = h^2 / 4 I in the grid's configuration, in
    which C is the gradient.
    """
    x = state.X0.astype(np.float64) + state.points.U.to_numpy()
    C, F = state.points.C.to_numpy().astype(np.float64), state.points.F.to_numpy().astype(np.float64)
    A = C @ F.transpose(0, 2, 1) if state.total else C
    axial = np.stack([A[:, 2, 1] - A[:, 1, 2], A[:, 0, 2] - A[:, 2, 0], A[:, 1, 0] - A[:, 0, 1]], axis=1)
    spin = state.medium.h**2 / 4 * axial
    return np.asarray((masses(state)[:, None] * (np.cross(x, state.points.V.to_numpy()) + spin)).sum(axis=0))


def kinetic(state: State) -> float:
    """Kinetic energy of the particles, that of the affine motion included [J]."""
    return float(kinetic_of_particles(state).sum())


def elastic(state: State) -> float:
    """Strain energy, degraded by damage [J]."""
    return float((state.observe()[1].astype(np.float64) * state.points.volume.to_numpy()).sum())
