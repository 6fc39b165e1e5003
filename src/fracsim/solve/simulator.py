"""The motion of a scene, frame by frame."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from fracsim.asset.frame import LatticeFrame
from fracsim.mpm import params as slot
from fracsim.mpm.drive import Drive
from fracsim.mpm.energy import carried
from fracsim.mpm.state import State
from fracsim.mpm.timestep import limit, rest_stiffness
from fracsim.records import Array, Frame, Particles
from fracsim.scene.vocab import CENTRE, Scene
from fracsim.solve import messages
from fracsim.solve.bonds import Bonds
from fracsim.solve.failed import FollowIntact
from fracsim.solve.fragments import Fragments
from fracsim.solve.march import March, Round, SimulationError
from fracsim.solve.messages import PATIENCE
from fracsim.solve.report import TEARING, EnergyTally, Report, Seen, failure_distance
from fracsim.solve.riders import Riders, moved
from fracsim.solve.settled import Settled
from fracsim.solve.setup import Ready, grips, in_memory_order, ready, wave_time
from fracsim.solve.shown import capped, stress_at
from fracsim.solve.tension import Tension
from fracsim.solve.uniaxial import uniaxial_bar

MAX_CLAMPED = 1e-2
"""Fraction of particles whose J may be clamped in a substep before the run stops. With dt auto it may be more, once
something has failed, for as long as a wave takes through the object and back: a piece of nearly its length that recoils
into its grip may be pressed there until the wave is back from its free end."""

Progress = Callable[[int, float, float], None]
"""Called with substeps done, present dt [s] and present time [s]."""


class Simulator:
    """Runs a scene: `for frame in Simulator(scene, particles).frames(): ...`.

    Particles and frames are those of the world; the state is in the frame of the lattices (`fracsim.asset.frame`).
    Frames hold particles in the order of `self.particles`; those without volume, which are drawn only, come last.
    `prepared` is what `ready(scene)` gave, if it was called before. Raises ValueError for a scene that cannot run, and
    SimulationError where something goes wrong.
    """

    def __init__(
        self, scene: Scene, particles: Particles, progress: Progress | None = None, prepared: Ready | None = None
    ) -> None:
        medium, warnings = prepared or ready(scene)
        self.lattice = LatticeFrame(scene.lattice_deg)
        self.scene, self.particles = scene, in_memory_order(particles, medium.h, self.lattice)
        self.moved = moved(self.particles)
        self.riders = Riders(self.particles, medium.h) if len(self.moved) < len(self.particles) else None
        turned = self.lattice.scene(scene)
        medium = replace(medium, gravity=tuple(turned.loading.gravity))
        drive = Drive.choose(scene.backend, len(self.moved), medium.solver.formulation)
        self.state = State(medium, replace(self.moved, X=self.lattice.points(self.moved.X)), grips(turned), drive)
        self.report = Report(scene, medium, self.moved, self.state.exempt, warnings)
        self.report.expected = uniaxial_bar(medium).breaks_at
        self.tension = Tension(scene.loading, self.moved.X, self.report.mass)
        self.progress = progress or (lambda n, dt, t: None)
        self.march = March(self.state)
        bonds = Bonds(self.moved.X, self.moved.spacing, medium.h)
        self.fragments = Fragments(self.state, bonds, scene.solver.particles_per_axis**3)
        self.follow_intact = FollowIntact(self.moved.X, medium.h)
        self.settled = Settled(turned.loading, 1 / scene.capture.fps, self.state.side)
        self._set_limits()

    def _set_limits(self) -> None:
        """How long particles may be crushed, and how many substeps the run may take; only dt auto has such limits."""
        medium, self._sound = self.state.medium, 0.0
        self._recoil, self._most = 0.0, math.inf
        at_rest = limit(medium, rest_stiffness(medium), self.scene.loading.speed, 0.0)
        if isinstance(self.scene.solver.dt, str) and at_rest > 0:
            s = (self.moved.X.astype(np.float64) - CENTRE) @ np.asarray(self.scene.loading.axis)
            self._recoil = wave_time(medium, float(np.ptp(s)))
            self._most = PATIENCE * max(self.scene.capture.duration / at_rest, 1)

    def frames(self) -> Iterator[Frame]:
        """Yield frame 0 (the rest state), 1, 2, ... of capture.frames."""
        self.state.start()
        for k in range(self.scene.capture.frames):
            if k and self.settled:
                U = self.state.points.U.to_numpy()
                self.state.points.U.from_numpy((U + self.settled.displacement()).astype(U.dtype))
            elif k:
                self._advance(k)
            yield self._frame(k)

    def _advance(self, k: int) -> None:
        """Substeps from frame k - 1 to frame k, the last one ending exactly there."""
        fps = self.scene.capture.fps
        for done in self.march.rounds((k - 1) / fps, 1 / fps):
            self.report.advanced(done.n, done.dt, done.t)
            self._check(k, done)
            self.progress(self.report.substeps, done.dt, done.t)

    def _check(self, k: int, done: Round) -> None:
        """Raise SimulationError for a fault of the last round, crushed particles, or substeps that are too short."""
        report = self.report
        if self.march.dt > done.bound and not any("at the present stretch" in w for w in report.warnings):
            report.warnings.append(messages.fixed_dt(self.march.dt, done.bound, len(report.history.t)))
        message = messages.of_state(self.state, k, report.substeps - done.n, self.lattice)
        if message:
            raise SimulationError(message)
        clamped = self.state.sums()[slot.CLAMPED] - report.clamped
        report.clamped += int(clamped)
        when = f"frame {k}, substep {report.substeps}"
        if clamped <= max(MAX_CLAMPED * self.state.n, 1) * done.n:
            self._sound = done.t
        elif done.t - self._sound > self._recoil or not (self.state.points.D.to_numpy() >= 1).any():
            raise SimulationError(messages.crushed(self.state, when, clamped / done.n))
        if report.substeps > self._most:
            raise SimulationError(messages.slow(self.state, when, done.dt))

    def _frame(self, k: int) -> Frame:
        """Read the particles, with F of at most lambda_crit; failed ones follow intact ones (`total`)."""
        s, t, report = self.state, k / self.scene.capture.fps, self.report
        world = self.lattice
        x = world.points_to_world(s.X0.astype(np.float64) + s.points.U.to_numpy() + np.asarray(CENTRE))
        x = x.astype(np.float32)
        self._hold(x, t)
        if s.total:
            self.fragments.update()
            report.crumbled = self.fragments.crumbled
        v, F, d = world.vectors_to_world(s.points.V.to_numpy()), s.points.F.to_numpy(), s.points.D.to_numpy()
        if s.boundary.mode == "rigid":
            held = s.side != 0
            v[held] = s.side[held, None] * s.boundary.speed * np.asarray(self.scene.loading.axis)
        seen = s.observe()
        failed = d >= 1
        verdict = "parted" if report.parted else self._verdict(x, world.tensors_to_world(F), failed)
        followers = failed & (s.total and not failed.all())  # they show what intact ones do, below
        F, beyond = capped(F, report.medium.fracture.crit, np.where(followers, 0, seen.stretch))
        tau = stress_at(s, F) if (beyond & ~failed).any() else seen.tau
        report.capped = max(report.capped, int((beyond & ~failed).sum()))
        F, tau = world.tensors_to_world(F), world.tensors_to_world(tau)
        if s.total:
            self.follow_intact(x, v, F, failed, self.fragments.of)
        frame = Frame(k, t, x, *(a.astype(np.float32) for a in (v, F, tau, d)))
        if self.scene.solver.until == "settled" and report.parted and not self.settled:
            self.settled.update(s.points.V.to_numpy(), s.points.C.to_numpy(), failed, self.fragments.of)
            report.settled_frame = k if self.settled else None
        energy = seen.energy
        energy -= s.params[slot.DT] / 2 * seen.power  # to the instant of the velocities, half a substep ago
        largest = float((seen.stretch[~failed] if s.total else seen.stretch).max(initial=1.0))
        tally, grid = EnergyTally.of(s.sums()), carried(s)
        load = self.tension(t, tally.impulse, world.vectors_to_world(grid.momentum), failed)
        report.add(frame, Seen(tally, energy, largest, float(grid.kinetic.sum()), load), verdict)
        return frame if self.riders is None else self.riders(frame, self.fragments.of)

    def _hold(self, x: Array, t: float) -> None:
        """Put what rigid grips hold exactly where they are at t [s]; x, (N, 3), changes in place."""
        s = self.state
        if s.boundary.mode == "rigid":
            held = s.side != 0
            shift = s.side[held, None] * s.boundary.speed * t * np.asarray(self.scene.loading.axis)
            x[held] = (self.moved.X[held] + shift).astype(np.float32)

    def _verdict(self, x: Array, F: Array, failed: Array) -> str:
        """Whether the object has just parted: `whole`, `broken` by damage, or `torn` numerically."""
        verdict = self.fragments.verdict(x, F, failed, self.report.stretch_max)
        # Where the grid lets go before lambda_crit, a broken object was torn by it.
        honest = self.state.total or failure_distance(self.state.medium, self.moved) <= TEARING
        return "torn" if verdict == "broken" and not honest else verdict
