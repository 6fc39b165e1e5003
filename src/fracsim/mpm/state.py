"""One simulation on the device: particles, grid, boundary, and the launches that move them."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from fracsim import backend, registry
from fracsim.arrays import Arrays
from fracsim.mpm import params as slot
from fracsim.mpm.boundary import Boundary, Holding
from fracsim.mpm.context import Variant
from fracsim.mpm.drive import Drive
from fracsim.mpm.grid import NodeGrid
from fracsim.mpm.kernels import substeps
from fracsim.mpm.lanes.side_by_side import SideBySide
from fracsim.mpm.layout import layout, separate_fragments
from fracsim.mpm.medium import Medium
from fracsim.mpm.points import Points
from fracsim.mpm.survey import observe, survey
from fracsim.mpm.timestep import bearable, damping, projection, rest_stiffness
from fracsim.records import Array, Particles
from fracsim.scene.vocab import CENTRE

MARGIN = 2
"""In `updated` the nodes in use are those of particles that have moved by at most this many cells."""

MOST_KICK = 1.25
"""Where substeps become shorter all at once, forces act over at most this many of them: a kick and a substep at 0.8 of
the bound are then stable, 1.25 0.8^2 < 1."""
INSTANT = 1e-12
"""A substep [s] in which nothing moves and no force acts, beyond round-off."""


def reals(precision: str) -> tuple[Any, Any]:
    """Taichi's and NumPy's type for `solver.precision`."""
    return (ti.f64, np.float64) if precision == "float64" else (ti.f32, np.float32)


@dataclass
class Peaks:
    """Maxima over the particles at one instant."""

    stiffness: float
    """Bound of the stiffness [Pa]."""
    fastest: float
    """Speed [m/s]."""
    rate: float
    """|C| [1/s]."""
    distance: float
    """From where a particle was when the grid was laid out, along an axis [m]."""


class Observables(NamedTuple):
    """What the particles show at one instant, degraded by damage."""

    tau: Array
    """Kirchhoff stresses (1 - d) tau [Pa], (N, 3, 3)."""
    energy: Array
    """Strain energy densities (1 - d) psi [Pa], (N,)."""
    stretch: Array
    """Largest stretches, (N,)."""
    power: Array
    """Power densities of the stress [W/m^3], (N,)."""


class State:
    """Particles, in the order given (see `fracsim.mpm.layout.order`), and grid of one simulation.

    `forced`: whether body forces act, which `points.force` holds [m/s^2].
    """

    def __init__(
        self, medium: Medium, particles: Particles, boundary: Boundary, drive: Drive, forced: bool = False
    ) -> None:
        self.medium, self.boundary, self.drive, self.forced = medium, boundary, drive, forced
        self.n, self.total, self.cellwise = len(particles), medium.total, medium.solver.cellwise
        self.real, self.dtype = reals(medium.solver.precision)
        self._law = registry.load("fracsim.constitutive", medium.material.law, "material.law")
        self._damage = registry.load("fracsim.damage", medium.fracture.law, "fracture.law")
        x = particles.X.astype(np.float64) - CENTRE
        self.side = boundary.side(x)
        self.exempt = boundary.exempt(x)
        self.X0 = x.astype(self.dtype)
        steps = np.rint(boundary.excess(x, particles.spacing) / slot.EXCESS).astype(np.int32)
        self.excess = steps * slot.EXCESS
        tag = (self.side + slot.FREE + slot.EXEMPT * self.exempt + slot.ABOVE * steps).astype(np.int32)
        self.points = Points(self.X0, particles.volume, tag, self.real, forced)
        y = self.X0 / medium.h if self.cellwise else None
        self._cell_starts = self.points.group_by_cell(y, drive.threads)
        V = self.side[:, None] * boundary.speed * np.asarray(boundary.axis)
        self.points.V.from_numpy(V.astype(self.dtype))
        self.grid = NodeGrid(self.real, self.dtype, drive.threads)
        laws = all(getattr(law, "LANES", False) for law in (self._law, self._damage))
        in_lanes = laws and self.total and drive.kind != "gpu" and boundary.mode != "soft"
        self.lanes = SideBySide(self.real, drive) if in_lanes else None
        self._allocate()
        self._saved: list[Any] = []
        self._fragment, self._offset = np.zeros(self.n, np.int64), np.zeros(1, np.int64)
        self.stiffness, self._last_dt = rest_stiffness(medium), 0.0
        self.pushed = 0.0
        """Time over which forces have acted [s]: half a substep less than has passed, where velocities are those of the
        middle of a substep (`fracsim.mpm.leapfrog`)."""
        self.params = self._constants()
        self.relayout(self.X0)

    def _allocate(self) -> None:
        """Arrays for what kernels find out."""
        threads = self.drive.threads
        self._wide = ti.f64 if backend.computes_doubles() else ti.f32
        make = self._arrays = Arrays(self)
        self._params = make.zeros(self.real, slot.PARAMETERS)
        self._sums = make.zeros(self._wide, threads, slot.ROW)
        self._peaks = make.zeros(self.real, threads, slot.PEAKS)
        self._faults = make.zeros(ti.i32, threads, 3)
        self._last = make.zeros(ti.i32, threads)
        self._tau = make.zeros(self.real, self.n, element=(3, 3))
        self._scalars = make.zeros(self.real, self.n, 3)

    def _constants(self) -> Array:
        """The kernels' parameters (PARAMETERS,); those that depend on the substep follow in `run`."""
        m, params = self.medium, np.zeros(slot.PARAMETERS)
        params[slot.CELL], params[slot.INV_CELL] = m.h, 1 / m.h
        params[slot.MU], params[slot.LAM], params[slot.DENSITY] = m.material.mu, m.material.lam, m.material.density
        params[slot.ONSET], params[slot.CRIT] = m.fracture.onset, m.fracture.crit
        params[slot.GX : slot.GZ + 1] = m.gravity
        params[slot.MAX_SPEED] = m.solver.max_speed
        params[slot.ROOM] = MARGIN * m.h
        params[slot.WALL] = 1.0 - 3 * m.h if m.solver.walls else 0.0
        self.boundary.fill(params)
        return params

    def relayout(self, x: Array, plane_offset: Array | None = None) -> None:
        """Lay out the grid around particles at x [m from the object's centre], (N, 3).

        `plane_offset`, (planes,), are the cells by which `split` has moved the planes of nodes. Raises ValueError for
        a grid that is too large.
        """
        margin = 0 if self.total else MARGIN
        box = layout(x / self.medium.h, self.drive.threads, margin, self._cell_starts)
        self.params[slot.LX : slot.LZ + 1] = box.lowest
        if self.total:
            holding = self.boundary.holding(box, box.positions(plane_offset) * self.medium.h)
        else:  # asks in each substep, for the present positions
            holding = Holding.by(np.zeros(1))
        self.grid.place(box, holding)
        if self.lanes is not None:
            # A particle on the face of a cell may reach a node that no other one does, by a weight below FACE^2 / 2.
            self.grid.clear()
            self.lanes.place(x / self.medium.h, box, self._cell_starts, self.side != 0, self.forced)
        self.points.anchor.copy_from(self.points.U)
        self.first_substep = True

    def split(self, fragment: Array) -> None:
        """Give each fragment its own nodes (`total`), so that fragments do not tie each other.

        `fragment`, (N,) int, is -1 for failed particles. Particles move in the rest configuration by whole cells, which
        changes no weight; nodes keep their velocities.
        """
        x, offset, of_plane = separate_fragments(self.X0, fragment, self.medium.h)
        present, first = np.unique(fragment, return_index=True)
        parent = self._fragment[first[present >= 0]]
        before = self.grid.layout, self.grid.velocity.to_numpy(), self._offset[parent]
        first_substep = self.first_substep
        self.points.X.from_numpy(x)
        self.relayout(x, offset[of_plane])
        self.grid.inherit(*before, offset, of_plane)
        self.first_substep, self._fragment, self._offset = first_substep, fragment, offset

    def survey(self) -> Peaks:
        """Maxima that limit the next substeps."""
        self._params.from_numpy(self.params.astype(self.dtype))
        b = self.points
        find = survey(self._law, self.total, self.cellwise, self.real)
        find(self._params, b.U, b.V, b.C, b.grad_u, b.D, b.volume, b.cell_counts, b.theta, b.anchor, self.grid.start,
             self._peaks)  # fmt: skip
        peaks = Peaks(*(float(p) for p in self._peaks.to_numpy().max(axis=0)))
        self.stiffness = peaks.stiffness
        return peaks

    def run(self, n: int, dt: float, t: float, turn: float = math.inf) -> int:
        """Advance by n substeps of length dt [s], from time t [s]; returns how many were made.

        Those are fewer when a particle turned or stretched by more than `turn` in one of them: the one after it is the
        last. No substep waits for the host.
        """
        self._set_substep(dt, t, turn)
        self._last.from_numpy(np.full(self.drive.threads, n, np.int32))
        self._params.from_numpy(self.params.astype(self.dtype))
        viscous = bool(self.params[slot.ETA] > 0)
        variant = Variant(self._law, self._damage, self.total, self.cellwise, viscous, self.forced, self.boundary.mode,
                          self.real)  # fmt: skip
        tally = self._sums, self._faults, self._last
        if self.lanes is not None:
            self.lanes.run(n, variant, self._params, self.points, self.grid, tally, self._wide)
        else:
            kernel = substeps(variant, self.drive.kind, self._wide)
            for step in range(1 if self.drive.kind == "serial" else n + 1):
                kernel(step, n, self._params, *self.points.arrays(), *self.grid.arrays(), *tally)
        self.first_substep, self._last_dt = False, dt
        made = min(n, int(self._last.to_numpy().min()) + 1) if turn < math.inf else n
        self.pushed += float(self.params[slot.KICK]) + (made - 1) * dt
        return made

    def start(self) -> None:
        """Give the nodes that grips hold their velocities before the first substep (`total`).

        The velocities at the start are part of the scene: they cost no impulse and no work. The first substep would
        set the nodes around a grip's face in motion by an inelastic impact, whose loss of energy is proportional to h.
        """
        if self.total and self.boundary.mode in ("rigid", "sliding"):
            rest = [(array, array.to_numpy()) for array in (self.points.U, self.points.grad_u)]
            self.run(1, INSTANT, 0.0)
            for array, values in rest:  # frame 0 is at rest, exactly
                array.from_numpy(values)
            self._sums.from_numpy(np.zeros(self._sums.shape))
            self.pushed = 0.0

    def _set_substep(self, dt: float, t: float, turn: float) -> None:
        """Set the parameters that depend on the substep."""
        damp, params = damping(self.medium, dt), self.params
        kick = min((self._last_dt + dt) / 2, MOST_KICK * dt) if self.total and self._last_dt else dt
        params[slot.DT], params[slot.TIME], params[slot.KICK] = dt, t, kick
        params[slot.ETA], params[slot.KEEP] = damp.viscosity / 2, damp.keep
        params[slot.ETA_MAX] = bearable(self.medium, max(dt, kick), self.stiffness) / 2
        soft = self.boundary.mode == "soft"  # acts on the velocities of particles, so these must be the nodes'
        params[slot.ALPHA] = 1.0 if soft else projection(self.medium, dt)
        params[slot.FIRST] = float(self.first_substep)
        params[slot.TURN] = min(turn * turn, 1e30)

    def save(self) -> None:
        """Keep what a run changes, for `restore`."""
        if not self._saved:
            self._saved = [self._arrays.like(array) for array in self._changing()]
        for saved, array in zip(self._saved, self._changing(), strict=True):
            saved.copy_from(array)

    def restore(self) -> None:
        """Undo what was run since `save`, a fault included (`updated`)."""
        for saved, array in zip(self._saved, self._changing(), strict=True):
            array.copy_from(saved)
        self.clear_fault()
        self.relayout(self.X0 + self.points.U.to_numpy())

    def _changing(self) -> tuple[Any, ...]:
        return *self.points.changing(), self._sums

    def clear_fault(self) -> None:
        """Forget a fault, and what it left on the grid."""
        self._faults.from_numpy(np.zeros(self._faults.shape, np.int32))
        self.grid.clear()

    def fault(self) -> tuple[int, int, int]:
        """Kind, particle and substep of the earliest fault; kind NO_FAULT when there is none."""
        rows = self._faults.to_numpy()
        rows = rows[rows[:, 0] != slot.NO_FAULT]
        if not len(rows):
            return slot.NO_FAULT, -1, -1
        kind, particle, step = rows[np.argmin(rows[:, 2])]
        return int(kind), int(particle), int(step)

    def observe(self) -> Observables:
        """What a frame needs of the particles, at their present F."""
        m, b = self.medium.material, self.points
        evaluate = observe(self._law, self.total, self.cellwise, self.real)
        evaluate(m.mu, m.lam, b.C, b.grad_u, b.D, b.volume, b.cell_counts, b.theta, self._tau, self._scalars)
        return Observables(self._tau.to_numpy(), *self._scalars.to_numpy().T)

    def sums(self) -> Array:
        """The sums over time in SI units, (SUMS,) float64."""
        sums: Array = np.asarray(self._sums.to_numpy(), np.float64)[:, : slot.SUMS].sum(axis=0)
        return sums
