"""Bodies on a lattice that no grip pulls: free or clamped, under body forces, with ghosts for periods and mirrors."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from fracsim.mpm import params as slot
from fracsim.mpm.energy import kinetic_of_particles, masses
from fracsim.mpm.layout import Layout, order
from fracsim.mpm.state import MARGIN, State
from fracsim.mpm.timestep import limit
from fracsim.records import Array, Particles
from fracsim.scene.vocab import CENTRE, Backend, Fracture, Loading, Material, Scene, Solver

FAR = 10.0
"""Beyond all bodies [m]."""
CRUSHED = 0.02
"""A stable substep this small a part of that at rest is not worth going on."""
ROUND = 16
"""Substeps between two looks at the stability bound."""
NEVER = Fracture(onset=9, crit=10)
"""Thresholds that no problem without damage reaches."""

Hook = Callable[[float, float], None]
"""Called before a substep with its start [s] and its length [s]; with 0 before a look at what limits the next ones."""


def lattice(size: tuple[float, float, float], spacing: float, centre: tuple[float, float, float] = CENTRE) -> Array:
    """Cell-centred lattice points of a box, (N, 3) float32."""
    counts = [max(1, round(s / spacing)) for s in size]
    axes = [c + spacing * (np.arange(n) - (n - 1) / 2) for c, n in zip(centre, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3).astype(np.float32)


def particles(X: Array, spacing: float, depth: float | None = None) -> Particles:
    """Particles of equal volume and grey colour; `depth` [m] is what one stands for along z in a plane problem."""
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
    """Points [m] sorted as particles lie best in memory."""
    return X[order((X - np.asarray(CENTRE)) / h)]


def bar(solver: Solver, size: tuple[float, float, float] = (0.6, 0.2, 0.2)) -> Particles:
    """A bar along x, filled at the solver's spacing."""
    return particles(ordered(lattice(size, solver.spacing), solver.h), solver.spacing)


def turned(body: Particles, degrees: float) -> Particles:
    """A body turned about z through the centre."""
    a = math.radians(degrees)
    turn = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    return replace(body, X=(CENTRE + (body.X - np.asarray(CENTRE)) @ turn.T).astype(np.float32))


def scene(solver: Solver, material: Material, X: Array) -> Scene:
    """A scene on one thread for a body at X [m] that lies on both sides of the centre."""
    s = X[:, 0].astype(float) - CENTRE[0]
    offset = min(0.5 * min(s.max(), -s.min()), 1.0)  # only for the solver to find its grips; nothing pulls
    return Scene(solver=solver, material=material, fracture=NEVER, backend=Backend(threads=1),
                 loading=Loading(offset=offset, thickness=min(2.2 * solver.spacing, offset)))  # fmt: skip


class Stage(State):
    """A state at rest whose nodes and particles at x <= -wall [m from the centre] are held, and no others.

    Body forces are `put(state, force=...)` [m/s^2]; they stay until they are put anew.
    """

    def __init__(self, scene: Scene, body: Particles, wall: float = math.inf) -> None:
        self.wall = wall
        super().__init__(scene, body, forces=True)
        self.force.from_numpy(np.zeros((self.n, 3), self.dtype))
        self.V.from_numpy(np.zeros((self.n, 3), self.dtype))
        self.label.from_numpy(slot.FREE - self._held(self.X0).astype(np.int32))

    def _held(self, x: Array) -> Array:
        return np.asarray(x[:, 0] <= 1e-6 - self.wall)

    def _fill_parameters(self) -> None:
        """Two slabs, FAR thick, from `wall` outwards; the body must not come near the upper one."""
        super()._fill_parameters()
        if math.isfinite(self.wall):
            assert self.X0[:, 0].max() < self.wall - 3 * self.scene.solver.h
            self.K[slot.SPEED], self.K[slot.HALF], self.K[slot.REACH] = 0.0, FAR + 1e-6, self.wall + FAR
        else:
            self.K[slot.HALF] = -1.0

    def _place_grid(self, grid: Layout, x: Array) -> None:
        super()._place_grid(grid, x)
        if self.total:
            self.owner.from_numpy(-self._held(x).astype(np.int32))
            self.tied.from_numpy(np.full((len(x), 2), -1, np.int32))


def free(scene: Scene, body: Particles) -> Stage:
    """A state whose particles and nodes no grip holds, at rest."""
    return Stage(scene, body)


def driven(scene: Scene, body: Particles, drive: str, chunks: int) -> State:
    """A state that runs its substeps by this drive, whatever the machine would choose."""

    class Driven(State):
        def _allocate(self, particles: Particles) -> None:
            self.drive, self.chunks = drive, chunks
            super()._allocate(particles)

    return Driven(scene, body)


def row(solver: Solver, material: Material, x: Array) -> Stage:
    """One row of particles at x [m from the centre], two a cell; to be kept straight by `flat(state, (1, 2))`."""
    X = 1 + x[:, None] * [1, 0, 0]
    return free(scene(solver, material, X), particles(X, solver.spacing))


def put(state: State, **values: ArrayLike) -> None:
    """Set arrays of the particles: `put(state, V=..., F=...)`; one row stands for all particles."""
    for name, value in values.items():
        array = getattr(state, name)
        shape = array.to_numpy().shape
        array.from_numpy(np.ascontiguousarray(np.broadcast_to(value, shape).astype(state.dtype)))


def slow(state: State, keep: float) -> None:
    """Leave particles and nodes this part of their velocity."""
    put(state, V=keep * state.V.to_numpy())
    nodes = state.velocity.to_numpy()
    nodes[:, :3] *= keep
    state.velocity.from_numpy(nodes)


def substep(state: State) -> float:
    """The substep that the scene's rule takes at the present state [s]."""
    rule, peaks, m = state.scene.solver.dt, state.survey(), state.scene.material
    if not isinstance(rule, str):
        return rule
    dt = limit(state.scene, peaks.stiffness, peaks.fastest, peaks.rate)
    if not dt > CRUSHED * limit(state.scene, 3 * m.lam + 2 * m.mu, 0.0, 0.0):
        raise RuntimeError("the material is crushed or has blown up: the stable substep has collapsed")
    return dt


def advance(state: State, duration: float, t: float = 0.0, before: Hook | None = None) -> int:
    """Substeps from t to t + duration [s]; returns how many.

    `before` is called before each of them. Raises RuntimeError when a particle leaves the solver's limits.
    """
    left, count = duration, 0
    while left > 1e-9 * duration:
        if before is not None:
            before(t, 0.0)
        dt = substep(state)
        n = max(1, math.ceil(left / dt - 1e-6))
        dt = left / n
        n = min(n, _safe(state, dt))
        if before is None:
            state.run(n, dt, t)
        else:
            for k in range(n):
                before(t + k * dt, dt)
                state.run(1, dt, t + k * dt)
        t, left, count = t + n * dt, left - n * dt, count + n
        check(state)
        follow(state)
    return count


def _safe(state: State, dt: float) -> int:
    """Substeps during which nobody leaves the nodes in use; few, for what snaps is soon faster than it is now."""
    if state.total:
        return ROUND
    fastest = float(np.linalg.norm(state.V.to_numpy(), axis=1).max())
    return max(1, min(ROUND // 4, int(MARGIN / 2 * state.scene.solver.h / max(fastest * dt, 1e-30))))


def check(state: State) -> None:
    """Raise RuntimeError for a fault of the solver."""
    kind, p, _ = state.fault()
    if kind != slot.NO_FAULT:
        raise RuntimeError(f"particle {p} {'flew too fast' if kind == slot.SPEED_FAULT else 'left the grid'}")


def follow(state: State) -> None:
    """In `updated`, lay the grid anew once somebody has moved a cell."""
    if not state.total:
        U = state.U.to_numpy()
        if np.abs(U - state.anchor.to_numpy()).max() > MARGIN / 2 * state.scene.solver.h:
            state.relayout(state.X0 + U)


def flat(state: State, axes: tuple[int, ...]) -> Hook:
    """A hook that takes motion and strain along `axes` away: with one layer of particles there, a plane or confined
    problem. Fields that do not vary along an axis have exact weights along it, so the layer stands for an endless one.
    """
    rest = np.eye(3, dtype=state.dtype)

    def flatten(t: float, dt: float) -> None:
        for name in ("U", "V", "C", "F"):
            array = getattr(state, name)
            values = array.to_numpy()
            for k in axes:
                values[:, k] = rest[k] if name == "F" else 0
                if values.ndim == 3:
                    values[:, :, k] = rest[k] if name == "F" else 0
            array.from_numpy(values)
        nodes = state.velocity.to_numpy()
        nodes[:, list(axes)] = 0
        state.velocity.from_numpy(nodes)

    return flatten


class Ghosts:
    """Particles that copy others before each substep, mirrored where `sign`, (G, 3), is -1."""

    def __init__(self, ghost: Array, image: Array, sign: Array) -> None:
        self.ghost, self.image, self.sign = ghost, image, sign

    def __call__(self, state: State) -> None:
        """Bring the ghosts up to date."""
        for name in ("U", "V", "C", "F"):
            array = getattr(state, name)
            values = array.to_numpy()
            copy = values[self.image] * self.sign.reshape(len(self.sign), *([3] + [1] * (values.ndim - 2)))
            values[self.ghost] = copy * self.sign[:, None, :] if values.ndim == 3 else copy
            array.from_numpy(values.astype(state.dtype))


def momentum(state: State) -> Array:
    """Total linear momentum [kg m/s]."""
    return np.asarray((masses(state)[:, None] * state.V.to_numpy()).sum(axis=0))


def angular_momentum(state: State) -> Array:
    """Total angular momentum about the object's centre, the spin of the affine motion included [kg m^2/s].

    Over the nodes of a quadratic B-spline sum w (x_i - x_p)(x_i - x_p)^T = h^2 / 4 I in the grid's configuration, in
    which C is the gradient.
    """
    x = state.X0.astype(np.float64) + state.U.to_numpy()
    C, F = state.C.to_numpy().astype(np.float64), state.F.to_numpy().astype(np.float64)
    A = C @ F.transpose(0, 2, 1) if state.total else C
    axial = np.stack([A[:, 2, 1] - A[:, 1, 2], A[:, 0, 2] - A[:, 2, 0], A[:, 1, 0] - A[:, 0, 1]], axis=1)
    spin = state.scene.solver.h**2 / 4 * axial
    return np.asarray((masses(state)[:, None] * (np.cross(x, state.V.to_numpy()) + spin)).sum(axis=0))


def kinetic(state: State) -> float:
    """Kinetic energy of the particles, that of the affine motion included [J]."""
    return float(kinetic_of_particles(state).sum())


def elastic(state: State) -> float:
    """Strain energy, degraded by damage [J]."""
    return float((state.observe()[1].astype(np.float64) * state.volume.to_numpy()).sum())
