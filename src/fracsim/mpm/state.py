"""The arrays of one simulation on the device, and the order of kernel launches."""

import math
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from fracsim import backend
from fracsim.mpm import params as slot
from fracsim.mpm.dilatation import KEPT, PAGE
from fracsim.mpm.grips import NOBODY, half_reach, holding, tags
from fracsim.mpm.kernels import substeps
from fracsim.mpm.layout import Layout, apart, crowds, layout
from fracsim.mpm.survey import observe, survey
from fracsim.mpm.timestep import bearable, damping, projection, rest_stiffness
from fracsim.mpm.transfer import PAD
from fracsim.records import Array, Particles
from fracsim.scene.vocab import CENTRE, Scene

MARGIN = 2
"""In `updated` the nodes in use are those of particles that have moved by at most this many cells."""
CHUNK = 4000
"""A second thread pays from this many particles on, a third from twice as many: starting a parallel loop costs time."""
MAX_NODES = 2**25
"""No grid larger than this is made: 1 GiB in float32, or 2 when it has grown, since Taichi keeps the smaller ones."""


def reals(precision: str) -> tuple[Any, Any]:
    """Taichi's and NumPy's type for `solver.precision`."""
    return (ti.f64, np.float64) if precision == "float64" else (ti.f32, np.float32)


@dataclass
class Peaks:
    """Maxima over the particles at one instant."""

    stiffness: float
    fastest: float
    rate: float
    moved: float


class Sight(NamedTuple):
    """What the particles show at one instant, of (1 - d) P and (1 - d) psi."""

    tau: Array
    """Degraded Kirchhoff stresses [Pa], (N, 3, 3)."""
    energy: Array
    """Strain energy densities [Pa], (N,)."""
    stretch: Array
    """Largest stretches, (N,)."""
    power: Array
    """Power densities of the stress [W/m^3], (N,)."""


class Deformation:
    """Deformation gradients F, (N, 3, 3), of which the device keeps F - I."""

    def __init__(self, H: Any) -> None:
        self._H = H

    def to_numpy(self) -> Array:
        """F, in the precision of the simulation."""
        H: Array = self._H.to_numpy()
        F: Array = H + np.eye(3, dtype=H.dtype)
        return F

    def from_numpy(self, F: Array) -> None:
        """Set F."""
        self._H.from_numpy(F - np.eye(3, dtype=F.dtype))


class State:
    """Particles (sorted by `Particles` order given) and grid of one simulation on the device."""

    def __init__(self, scene: Scene, particles: Particles, forces: bool = False) -> None:
        """`forces`: whether body forces act, which `self.force` holds [m/s^2]."""
        self.forces, self.stiffness = forces, rest_stiffness(scene)
        self.scene, self.n = scene, len(particles)
        self.fragment, self.moved = np.zeros(self.n, np.int64), np.zeros(1, np.int64)
        self.total = scene.solver.formulation == "total"
        self.real, self.dtype = reals(scene.solver.precision)
        self.tag = tags(scene, particles.X)
        self.chunks = min(backend.threads(scene.backend), 1 + self.n // CHUNK) if backend.on_cpu() else 1
        self.drive = "gpu" if not backend.on_cpu() else "serial" if self.chunks == 1 else "threads"
        self.wide = ti.f64 if backend.has_doubles(scene.backend) else ti.f32
        self.X0 = (particles.X - np.asarray(CENTRE)).astype(self.dtype)
        self.cellwise = scene.solver.cellwise
        self.kept: list[Any] = []
        self.velocity: Any = None
        self.copies: Any = None
        self._allocate(particles)
        self._fill_parameters()
        self.relayout(self.X0)

    def _allocate(self, particles: Particles) -> None:
        """Make the particle arrays; grips move from the first instant on."""
        n, real = self.n, self.real
        self.X, self.U, self.V = (ti.Vector.ndarray(3, real, n) for _ in range(3))
        self.C, self.H = (ti.Matrix.ndarray(3, 3, real, n) for _ in range(2))
        self.D, self.volume, self.share = (ti.ndarray(real, n) for _ in range(3))
        self.label = ti.ndarray(ti.i32, n)
        self.anchor = ti.Vector.ndarray(3, real, n)
        self.force = ti.Vector.ndarray(3, real, n if self.forces else 1)
        self.tau = ti.Matrix.ndarray(3, 3, real, n)
        self.scalars = ti.ndarray(real, (n, 3))
        self._sort_cells()
        self.X.from_numpy(self.X0)
        self.volume.from_numpy(particles.volume.astype(self.dtype))
        self.label.from_numpy(self.tag)
        self.F = Deformation(self.H)
        load = self.scene.loading
        side = self.tag % slot.EXEMPT - slot.FREE
        self.V.from_numpy((side[:, None] * load.speed * np.asarray(load.axis)).astype(self.dtype))
        self.pad = ti.Vector.ndarray(4, real, self.chunks * PAD)
        self.pad.from_numpy(np.zeros((self.chunks * PAD, 4), self.dtype))
        self.books = ti.ndarray(self.wide, (self.chunks, slot.BOOKS))
        self.peaks = ti.ndarray(real, (self.chunks, slot.PEAKS))
        self.faults = ti.ndarray(ti.i32, (self.chunks, 3))
        self.halt = ti.ndarray(ti.i32, self.chunks)

    def _sort_cells(self) -> None:
        """Who shares a cell at rest with whom, which fragments don't change."""
        many = crowds(self.X0 / self.scene.solver.h) if self.cellwise else np.zeros(1, np.int32)
        self.heads = np.flatnonzero(many) if self.cellwise else None
        self.many, self.theta = ti.ndarray(ti.i32, len(many)), ti.ndarray(self.real, len(many))
        self.many.from_numpy(many)
        self.theta.from_numpy(np.ones(len(many), self.dtype))
        self.wait = ti.Vector.ndarray(
            4, self.real, (self.chunks, max(PAGE, KEPT << max(int(many.max()) - 1, 0).bit_length()))
        )
        self.wait.from_numpy(np.zeros((*self.wait.shape, 4), self.dtype))

    def _fill_parameters(self) -> None:
        """Constants of the scene; DT, TIME, ETA and KEEP follow at each call."""
        s, K = self.scene, np.zeros(slot.PARAMETERS)
        K[slot.H], K[slot.RH] = s.solver.h, 1 / s.solver.h
        K[slot.MU], K[slot.LAM], K[slot.DENSITY] = s.material.mu, s.material.lam, s.material.density
        K[slot.ONSET], K[slot.CRIT] = s.fracture.onset, s.fracture.crit
        K[slot.SPEED], K[slot.UX : slot.UZ + 1] = s.loading.speed, s.loading.axis
        K[slot.REACH], K[slot.HALF] = s.loading.offset, half_reach(s)
        K[slot.GX : slot.GZ + 1] = s.loading.gravity
        K[slot.MAX_SPEED] = s.solver.max_speed
        K[slot.ROOM] = MARGIN * s.solver.h
        K[slot.WALL] = 1.0 - 3 * s.solver.h if s.solver.walls else 0.0
        self.K = K
        self.parameters = ti.ndarray(self.real, slot.PARAMETERS)

    def relayout(self, x: Array, aside: Array | None = None) -> None:
        """Lay the grid around particles at x [m from the object's centre]; `aside` are the cells that the planes of
        nodes were moved by `split`."""
        self.layout = layout(x / self.scene.solver.h, self.chunks, 0 if self.total else MARGIN, self.heads)
        if max(self.layout.size, self.layout.copies) > MAX_NODES:
            raise ValueError(
                f"the grid would need {self.layout.size:,} nodes: choose fewer solver.cells={self.scene.solver.cells}."
            )
        self.K[slot.LX : slot.LZ + 1] = self.layout.lowest
        self._place_grid(self.layout, self.layout.positions(aside) * self.scene.solver.h)
        self.anchor.copy_from(self.U)
        self.fresh = True

    def split(self, label: Array) -> None:
        """Give each fragment nodes of its own (`total`): its particles, label >= 0, are moved aside in the rest
        configuration by whole cells, which changes no weight. Fragments then share no node and do not tie each other.
        """
        x, moved, fragment = apart(self.X0, label, self.scene.solver.h)
        of, first = np.unique(label, return_index=True)
        parent = self.fragment[first[of >= 0]]
        before, fresh = (self.layout, self.velocity.to_numpy(), self.moved[parent]), self.fresh
        self.X.from_numpy(x)
        self.relayout(x, moved[fragment])
        self._inherit(*before, moved, fragment)
        self.fresh, self.fragment, self.moved = fresh, label, moved

    def _inherit(self, old: Layout, velocity: Array, was: Array, moved: Array, fragment: Array) -> None:
        """Give nodes the velocity that the node at their place had in the layout before the last one, in which each
        fragment lay `was` cells aside instead of `moved`."""
        index = np.stack(np.unravel_index(self.layout.nodes, self.layout.shape), axis=1)
        of = fragment[index[:, 0]]
        index += self.layout.lowest - old.lowest
        index[:, 0] += was[of] - moved[of]
        known = ((index >= 0) & (index < old.shape)).all(axis=1)  # others are near failed particles only
        out = np.zeros((self.velocity.shape[0], 4), self.dtype)
        out[self.layout.nodes[known]] = velocity[np.ravel_multi_index(tuple(index[known].T), old.shape)]
        self.velocity.from_numpy(out)

    def _place_grid(self, grid: Layout, x: Array) -> None:
        """Device arrays of a layout whose nodes are at x at rest, the momenta zero."""

        def device(values: Array) -> Any:
            array = ti.ndarray(ti.i32, values.shape)
            array.from_numpy(np.ascontiguousarray(values, np.int32))
            return array

        self.velocity = self._at_least(self.velocity, grid.size)
        self.copies = self._at_least(self.copies, grid.copies)
        self.nodes, self.source = device(grid.nodes), device(grid.source)
        hold = holding(self.scene, grid, x) if self.total else NOBODY  # `updated` asks at each substep
        self.owner, self.tied = device(hold.owner), device(hold.tied)
        self.tie_share = ti.ndarray(self.real, hold.share.shape)
        self.tie_share.from_numpy(hold.share.astype(self.dtype))
        self.shift, self.start = device(grid.shift), device(grid.start)

    def _at_least(self, array: Any, size: int) -> Any:
        """A device array of at least `size` nodes: this one, or a new one twice as large.

        Taichi keeps the memory of arrays that are gone. What a substep leaves in an array is zero (`copies`) or written
        before it is read.
        """
        if array is not None and array.shape[0] >= size:
            return array
        return ti.Vector.ndarray(4, self.real, max(size, 1 if array is None else min(2 * array.shape[0], MAX_NODES)))

    def survey(self) -> Peaks:
        """Maxima that limit the next substeps."""
        self.parameters.from_numpy(self.K.astype(self.dtype))
        look = survey(self.scene.material.law, self.total, self.cellwise, self.real)
        look(self.parameters, self.U, self.V, self.C, self.H, self.D, self.volume, self.many, self.theta, self.anchor,
             self.start, self.peaks)  # fmt: skip
        peaks = Peaks(*(float(p) for p in self.peaks.to_numpy().max(axis=0)))
        self.stiffness = peaks.stiffness
        return peaks

    def run(self, n: int, dt: float, t: float, turn: float = math.inf) -> int:
        """Advance by n substeps of length dt [s], from time t [s]; returns how many were made.

        Those are fewer when a particle turned or stretched by more than `turn` in one of them: the one after it is the
        last. No substep waits for the host to look.
        """
        damp = damping(self.scene, dt)
        self.K[slot.DT], self.K[slot.TIME] = dt, t
        self.K[slot.ETA], self.K[slot.KEEP] = damp.viscosity / 2, damp.keep
        self.K[slot.ETA_MAX] = bearable(self.scene, dt, self.stiffness) / 2
        self.K[slot.ALPHA], self.K[slot.FRESH] = projection(self.scene, dt), float(self.fresh)
        self.K[slot.TURN] = min(turn * turn, 1e30)
        self.halt.from_numpy(np.full(self.chunks, n, np.int32))
        self.fresh = False
        self.parameters.from_numpy(self.K.astype(self.dtype))
        s = self.scene
        kernel = substeps(s.material.law, s.fracture.law, self.total, self.cellwise, damp.viscosity > 0, self.forces,
                          s.loading.grips, self.drive, self.real, self.wide)  # fmt: skip
        arrays = (
            self.parameters, self.X, self.U, self.V, self.C, self.H, self.D, self.volume, self.label, self.anchor,
            self.force, self.many, self.theta, self.wait, *self.layout.strides, 0.0, self.velocity, self.copies,
            self.pad, self.nodes, self.owner, self.tied, self.tie_share, self.source, self.shift, self.start,
            self.books, self.faults, self.halt,
        )  # fmt: skip
        if self.drive == "serial":
            kernel(n, *arrays)
        else:
            for step in range(n + 1):
                kernel(step, int(step > 0), int(step < n), *arrays)
        return min(n, int(self.halt.to_numpy().min()) + 1) if turn < math.inf else n

    def save(self) -> None:
        """Keep what a run changes, for `restore`."""
        if not self.kept:
            self.kept = [deepcopy(array) for array in self._changing()]
        for kept, array in zip(self.kept, self._changing(), strict=True):
            kept.copy_from(array)

    def restore(self) -> None:
        """Undo what was run since `save`, a fault included (`updated`)."""
        for kept, array in zip(self.kept, self._changing(), strict=True):
            array.copy_from(kept)
        for array in (self.faults, self.pad, self.copies):
            array.from_numpy(np.zeros_like(array.to_numpy()))  # fill() would compile a kernel for each array
        self.relayout(self.X0 + self.U.to_numpy())

    def _changing(self) -> tuple[Any, ...]:
        return self.U, self.V, self.C, self.H, self.D, self.books

    def fault(self) -> tuple[int, int, int]:
        """Kind, particle and substep of the earliest fault; kind 0 when there is none."""
        rows = self.faults.to_numpy()
        rows = rows[rows[:, 0] != slot.NO_FAULT]
        if not len(rows):
            return slot.NO_FAULT, -1, -1
        kind, particle, step = rows[np.argmin(rows[:, 2])]
        return int(kind), int(particle), int(step)

    def observe(self) -> Sight:
        """What a frame needs of the particles, at their present F."""
        m = self.scene.material
        look = observe(m.law, self.total, self.cellwise, self.real)
        look(m.mu, m.lam, self.C, self.H, self.D, self.tau, self.scalars, self.volume, self.many, self.theta)
        return Sight(self.tau.to_numpy(), *self.scalars.to_numpy().T)

    def booked(self) -> Array:
        """The running sums, (BOOKS,) float64."""
        sums: Array = np.asarray(self.books.to_numpy(), np.float64).sum(axis=0)
        return sums
