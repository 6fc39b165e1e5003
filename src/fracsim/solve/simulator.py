"""The motion of a scene, frame by frame."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from fracsim.backend import has_doubles
from fracsim.mpm import params as slot
from fracsim.mpm.energy import kinetic
from fracsim.mpm.grips import along
from fracsim.mpm.layout import order
from fracsim.mpm.state import MARGIN, Peaks, State
from fracsim.mpm.timestep import GROWTH, ROTATION, limit, require_stable, rest_stiffness, stable
from fracsim.records import Array, Frame, Particles
from fracsim.scene.vocab import CENTRE, Scene
from fracsim.solve.failed import Ride
from fracsim.solve.fragments import Cohesion
from fracsim.solve.report import TEARING, Books, Report, failure_reach
from fracsim.solve.settled import Rest
from fracsim.solve.uniaxial import bar, regularised

ROUND = 16
"""Substeps between two looks at the stability bound, unless a particle turns or stretches too much before."""
RISKY = 1.2
"""Below this stretch the grid of `updated` does not tear anything."""
MAX_CLAMPED = 1e-2
"""Fraction of particles whose J may be clamped in a substep before the run stops. With dt auto it may be more, once
something has failed, for as long as a wave takes through the object and back: so long a piece of nearly its length that
recoils into its grip may be pressed there, until the wave is back from its free end."""
PATIENCE = 100
"""With dt auto, a run stops that has taken this many times the substeps that all of it takes at rest."""

Progress = Callable[[int, float, float], None]
"""Called with substeps done, present dt [s] and present time [s]."""


class SimulationError(RuntimeError):
    """The simulation left its limits; says which particle, frame and field, and the likely cause."""


def sort(scene: Scene, particles: Particles) -> Particles:
    """Particles in the order in which they lie in memory: neighbours in space are neighbours there."""
    by = order((particles.X - np.asarray(CENTRE)) / scene.solver.h)
    names = ("X", "volume", "covariance", "opacity", "sh", "surface")
    return replace(particles, **{name: getattr(particles, name)[by] for name in names})


def ready(scene: Scene) -> tuple[Scene, list[str]]:
    """The scene with the lambda_crit that its cells need, and warnings; needs Taichi, but no object.

    Raises ValueError for a precision, a substep or a `fracture.length` that cannot be used.
    """
    if scene.solver.precision == "float64" and not has_doubles(scene.backend):
        raise ValueError(
            f"solver.precision=float64 is not possible with backend.arch={scene.backend.arch}: use float32, or "
            "backend.arch=cpu or cuda."
        )
    warning = require_stable(scene)
    return regularised(scene), [warning] if warning else []


class Simulator:
    """Runs a scene: `for frame in Simulator(scene, particles).frames(): ...`.

    Frames hold particles in the order of `self.particles`. Raises ValueError for a scene that cannot run, and
    SimulationError at the substep where something goes wrong.
    """

    def __init__(self, scene: Scene, particles: Particles, progress: Progress | None = None) -> None:
        scene, warnings = ready(scene)
        self.scene, self.particles = scene, sort(scene, particles)
        self.state = State(scene, self.particles)
        self.report = Report(scene, self.particles, self.state.tag, warnings)
        self.report.expected = bar(scene).breaks_at
        self.progress = progress or (lambda n, dt, t: None)
        self.side = self.state.tag % slot.EXEMPT - slot.FREE
        self.ride = Ride(self.particles.X, scene.solver.h)
        self.cohesion = Cohesion(self.particles.X, self.particles.spacing, scene.solver.h, self.side)
        self.rest = Rest(scene, self.side)
        self.fragment = np.zeros(len(self.particles), np.int64)
        self.dt, self.sound = math.inf, 0.0
        length = float(np.ptp(along(scene.loading, self.particles.X)))
        at_rest = limit(scene, rest_stiffness(scene), scene.loading.speed, 0.0)
        self.recoil, self.most = 0.0, math.inf
        if isinstance(scene.solver.dt, str) and at_rest > 0:
            self.recoil = 2 * length * math.sqrt(scene.material.density / scene.material.E)
            self.most = PATIENCE * max(scene.capture.duration / at_rest, 1)

    def frames(self) -> Iterator[Frame]:
        """Yield frame 0 (the rest state), 1, 2, ... of capture.frames."""
        for k in range(self.scene.capture.frames):
            if k and self.rest.settled:
                self._coast()
            elif k:
                self._advance(k)
            yield self._frame(k)

    def _advance(self, k: int) -> None:
        """Substeps from frame k - 1 to frame k, the last one ending exactly there."""
        fps = self.scene.capture.fps
        t, left = (k - 1) / fps, 1 / fps
        while left > 1e-9 / fps:
            peaks = self.state.survey()
            dt, n = self._choose(peaks, left)
            if self.report.substeps > self.most:
                raise SimulationError(self._slow(k, dt))
            n = self._run(n, dt, t)
            t, left = t + n * dt, left - n * dt
            self.report.advanced(n, dt, t)
            self._check(k, self.report.substeps - n)
            self.progress(self.report.substeps, dt, t)
            if not self.state.total:
                self._follow()

    def _coast(self) -> None:
        """Let settled pieces move on for a frame."""
        U = self.state.U.to_numpy()
        self.state.U.from_numpy((U + self.rest.way(1 / self.scene.capture.fps)).astype(U.dtype))

    def _choose(self, peaks: Peaks, left: float) -> tuple[float, int]:
        """Length and number of the next substeps; all those left in the frame are equally long."""
        s = self.scene
        if isinstance(s.solver.dt, str):
            bound = limit(s, peaks.stiffness, peaks.fastest, peaks.rate)
            self.dt = min(bound, self.dt * GROWTH**ROUND)
        else:
            self.dt = s.solver.dt
            self._warn_of(stable(s, peaks.stiffness))
        if not self.dt > 0:
            raise SimulationError(
                "the stability bound of solver.dt=auto is not a number (field F): the material has blown up. "
                "Use a smaller solver.safety."
            )
        steps = max(1, math.ceil(left / self.dt - 1e-6))
        dt = left / steps
        n = math.ceil(steps / math.ceil(steps / ROUND))  # rounds of equal length, none of a single substep
        if not self.state.total and peaks.fastest > 0:  # nobody may leave the nodes in use
            n = min(n, max(1, int(MARGIN / 2 * s.solver.h / (peaks.fastest * dt))))
        return dt, n

    def _warn_of(self, bound: float) -> None:
        """Say once that a fixed dt exceeds the bound of what is stretched by now."""
        if self.dt > bound and not any("at the present stretch" in w for w in self.report.warnings):
            self.report.warnings.append(
                f"solver.dt={self.dt:g} s exceeds the stability bound at the present stretch, {bound:.3g} s, from "
                f"frame {len(self.report.history.t)} on: use solver.dt=auto"
            )

    def _run(self, n: int, dt: float, t: float) -> int:
        """Run n substeps; returns how many, fewer when in `updated` somebody would have left the nodes in use.

        Where the grid lets go, particles are suddenly as fast as the waves.
        """
        if not self.state.total:
            self.state.save()
        turn = 2 * ROTATION if isinstance(self.scene.solver.dt, str) else math.inf
        n = self.state.run(n, dt, t, turn)
        while not self.state.total and n > 1 and self.state.fault()[0] == slot.GRID_FAULT:
            n = max(1, n // 4)
            self.state.restore()
            n = self.state.run(n, dt, t, turn)
        return n

    def _follow(self) -> None:
        """In `updated`, lay the grid anew once somebody has moved a cell."""
        moved = float(np.abs(self.state.U.to_numpy() - self.state.anchor.to_numpy()).max())
        if moved > MARGIN / 2 * self.scene.solver.h:
            x = self.state.X0 + self.state.U.to_numpy()
            try:
                self.state.relayout(x)
            except ValueError as error:
                p = int(np.abs(x).max(axis=1).argmax())
                raise SimulationError(
                    f"particle {p} has flown off to {(x[p] + np.asarray(CENTRE)).round(2)} m (field x): {error}"
                ) from error

    def _check(self, k: int, before: int) -> None:
        """Raise SimulationError for the first fault since the last look."""
        kind, p, step = self.state.fault()
        if kind != slot.NO_FAULT:
            x = self.state.X0[p] + self.state.U.to_numpy()[p] + np.asarray(CENTRE)
            v = self.state.V.to_numpy()[p]
            raise SimulationError(self.report.fault(kind, p, k, max(before + step, 0), x, v))
        clamped = self.state.booked()[slot.CLAMPED] - self.report.clamped
        self.report.clamped += int(clamped)
        steps, now = self.report.substeps - before, self.report.history.dt_t[-1]
        if clamped <= max(MAX_CLAMPED * self.state.n, 1) * steps:
            self.sound = now
        elif now - self.sound > self.recoil or not (self.state.D.to_numpy() >= 1).any():
            raise SimulationError(self._crushed(k, clamped / steps))

    def _crushed(self, k: int, many: float) -> str:
        """The message when too many particles are inverted or crushed; names the worst of them."""
        J = np.where(self.state.D.to_numpy() < 1, np.linalg.det(self.state.F.to_numpy()), np.inf)
        p = int(J.argmin())
        return (
            f"frame {k}, substep {self.report.substeps}: {many:.0f} particles a substep are inverted or crushed, the "
            f"worst by now is particle {p} (field F, J = {J[p]:.2g}; crushed is below 0.05). Likely the substep is too "
            "long or the thresholds let the material stretch too far: use solver.dt=auto or a smaller solver.safety."
        )

    def _slow(self, k: int, dt: float) -> str:
        """The message when the stability bound has fallen too far; names the thinnest particle."""
        intact = np.flatnonzero(self.state.D.to_numpy() < 1)
        stretch = np.linalg.svd(self.state.F.to_numpy()[intact], compute_uv=False)
        p = int(stretch[:, 2].argmin())
        exempt = self.state.tag[intact[p]] >= slot.EXEMPT
        way = "fracture.at_grips=true, so that it may fail" if exempt else "a slower loading.speed"
        return (
            f"frame {k}, substep {self.report.substeps}: the run has taken {PATIENCE} times the substeps that all of "
            f"it takes at rest, since solver.dt=auto is down to {dt:.2g} s: particle {intact[p]} (field F) has "
            f"stretches from {stretch[p, 2]:.2g} to {stretch[p, 0]:.3g}. Use {way}, or fewer capture.frames."
        )

    def _frame(self, k: int) -> Frame:
        """Read the particles; failed ones ride (`total`) and show at most lambda_crit."""
        s, t = self.state, k / self.scene.capture.fps
        x = (s.X0.astype(np.float64) + s.U.to_numpy() + np.asarray(CENTRE)).astype(np.float32)
        held = self.side != 0
        if self.scene.loading.grips == "rigid":
            shift = self.side[held, None] * self.scene.loading.speed * t * np.asarray(self.scene.loading.axis)
            x[held] = (self.particles.X[held] + shift).astype(np.float32)
        if s.total:
            self._part()
        v, F, d = s.V.to_numpy(), s.F.to_numpy(), s.D.to_numpy()
        if self.scene.loading.grips == "rigid":
            v[held] = self.side[held, None] * self.scene.loading.speed * np.asarray(self.scene.loading.axis)
        tau, energy, stretch, power = s.observe()
        energy -= s.K[slot.DT] / 2 * power  # as velocities are those of half a substep ago
        failed = d >= 1
        if s.total:
            self.ride(x, v, F, failed, self.fragment)
        verdict = self._verdict(x, F, failed)
        frame = Frame(k, t, x, v.astype(np.float32), F.astype(np.float32), tau.astype(np.float32), d.astype(np.float32))
        intact = stretch[~failed] if s.total else stretch
        largest = float(intact.max(initial=1.0))
        if self.scene.solver.until == "settled" and self.report.parted and not self.rest.settled:
            self.rest.look(s.V.to_numpy(), s.C.to_numpy(), failed, self.fragment)
            self.report.settled_frame = k if self.rest.settled else None
        self.report.frame(frame, Books.of(s.booked()), energy, largest, float(kinetic(s).sum()), verdict)
        return frame

    def _part(self) -> None:
        """In `total`, give fragments that hold together no longer nodes of their own; what is too small for the grid
        fails with the crack."""
        d = self.state.D.to_numpy()
        if int((d >= 1).sum()) == int((self.fragment < 0).sum()):
            return
        label = self.cohesion.fragments(d >= 1)
        if (label < 0).all():
            self.fragment = label
            return
        size = np.bincount(label[label >= 0])
        crumb = (label >= 0) & (size[label] < self.scene.solver.particles_per_axis**3) & (self.side == 0)
        if crumb.any():
            before = self.report.volume @ self.state.observe()[1] + kinetic(self.state).sum()
            d[crumb], label[crumb] = 1, -1
            label[label >= 0] = np.unique(label[label >= 0], return_inverse=True)[1]  # without gaps again
            self.state.D.from_numpy(d)
            after = self.report.volume @ self.state.observe()[1] + kinetic(self.state).sum()
            self.report.crumbled += float(before - after)
        intact = label >= 0
        if (label[intact] != self.fragment[intact]).any():
            self.state.split(label)
        self.fragment = label

    def _verdict(self, x: Array, F: Array, failed: Array) -> str:
        """Whether the object has just parted, and why; asked only until it has and once it can have."""
        if self.report.parted:
            return "parted"
        if self.state.total:
            return "whole" if self.cohesion.joins(self.fragment) else "broken"
        if self.report.stretch_max < RISKY:
            return "whole"
        verdict = self.cohesion.judge(x, F, failed)
        honest = failure_reach(self.scene, self.particles) <= TEARING
        return "torn" if verdict == "broken" and not honest else verdict
