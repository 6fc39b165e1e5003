"""Invariants that must hold at every frame of any finished run.

Sums are formed in the precision of the run, so conservation laws hold to round-off: in each substep EPS, the machine
epsilon, times the sum of magnitudes. The energy law is one-sided: energy must not appear, but transfers may lose it.
"""

import json
import math

import numpy as np

from fracsim.lab.stage import momentum
from fracsim.mpm import params as slot
from fracsim.mpm.timestep import damping
from fracsim.records import Array, Frame
from fracsim.scene.vocab import CENTRE
from fracsim.solve.report import History
from fracsim.solve.simulator import Simulator

CREATED = 0.05
"""Energy that may appear by the error of symplectic Euler, as part of the work done and the initial energy."""
NEGLIGIBLE = 1e-12
"""Nodes with less than this part of a cell's mass count as empty, and their momentum is lost."""
SUMMED = 8.0
"""Round-off of a substep in units of EPS: a node sums 8 to 64 particles, each with rounded weights."""


class Watch:
    """Checks a run. `violations` has one sentence for the first violation of each kind."""

    def __init__(self, simulator: Simulator, sensible: bool = True) -> None:
        """`sensible`: see `fracsim.fuzz.case.sensible`."""
        self.sim, self.scene, self.sensible = simulator, simulator.scene, sensible
        self.eps = float(np.finfo(simulator.state.dtype).eps)
        self.mass = simulator.report.mass
        self.violations: list[str] = []
        self._kinds: set[str] = set()
        self._last_d = np.zeros(len(self.mass))
        self._start = np.zeros(3)
        self._work: list[float] = []
        self._gross_work = self._largest_sum = 0.0
        simulator.progress = self.round

    def violated(self, kind: str, sentence: str) -> None:
        """Record the first violation of a kind."""
        if kind not in self._kinds:
            self._kinds.add(kind)
            self.violations.append(f"{kind}: {sentence}")

    def round(self, substeps: int, dt: float, t: float) -> None:
        """After the last substeps of a frame: the grid has the mass of the particles, and all particles are on it."""
        if abs(t * self.scene.capture.fps - round(t * self.scene.capture.fps)) > 1e-6:
            return
        s = self.sim.state
        active = s.points.D.to_numpy() < 1 if s.total else np.ones(s.n, bool)
        on_nodes = float(s.grid.velocity.to_numpy()[s.grid.layout.nodes, 3].sum(dtype=np.float64))
        least, most = self.mass[active].sum(), self.mass[self._last_d < 1].sum() if s.total else self.mass.sum()
        slack = SUMMED * self.eps * math.sqrt(s.n) * self.mass.sum()
        if not least - slack <= on_nodes <= most + slack:
            self.violated("mass", f"{on_nodes:g} kg on the grid at {t:g} s, {least:g} to {most:g} kg in particles")
        x = s.points.X.to_numpy() if s.total else s.points.X.to_numpy() + s.points.U.to_numpy()
        cell = np.floor(x[active] / self.scene.solver.h - 0.5) - s.grid.layout.lowest
        if len(cell) and (cell.min() < 0 or (cell.max(axis=0) + 2 >= s.grid.layout.shape).any()):
            self.violated("grid", f"a particle is outside the grid at {t:g} s")

    def frame(self, frame: Frame) -> None:
        """Check a frame, and the report and energy tally up to it."""
        self._finite(frame)
        self._damage(frame)
        self._positions(frame)
        self._report(frame)
        self._momentum(frame)
        self._energy(frame)
        self._last_d = frame.d

    def _finite(self, frame: Frame) -> None:
        """All arrays of the frame and the state are finite."""
        s = self.sim.state
        arrays = {"x": frame.x, "v": frame.v, "F": frame.F, "tau": frame.tau, "d": frame.d,
                  "the state's U": s.points.U.to_numpy(), "the state's F": s.points.F.to_numpy()}  # fmt: skip
        for name, values in arrays.items():
            bad = ~np.isfinite(values)
            if bad.any():
                self.violated("finite", f"{name} of {int(bad.sum())} numbers at frame {frame.index}")

    def _damage(self, frame: Frame) -> None:
        """Damage is in [0, 1] and never falls."""
        if not ((frame.d >= 0) & (frame.d <= 1)).all():
            self.violated("damage", f"outside [0, 1] at frame {frame.index}: {frame.d.min():g} to {frame.d.max():g}")
        fallen = self._last_d - frame.d
        if fallen.max() > 0:
            self.violated("damage", f"fell by {fallen.max():g} at frame {frame.index}")

    def _positions(self, frame: Frame) -> None:
        """The frame's positions are those of the state; grips have moved by v t along the axis."""
        s, load, world = self.sim.state, self.scene.loading, self.sim.lattice
        held, intact = self.sim.state.side != 0, frame.d < 1
        U = world.vectors_to_world(s.points.U.to_numpy().astype(np.float64))
        X0 = world.vectors_to_world(s.X0.astype(np.float64))
        shown = frame.x - np.asarray(CENTRE)
        free = ~held & (intact | (not s.total))
        # x is float32, and a sum of X and U in the precision of the run.
        tolerance = 4 * np.finfo(np.float32).eps * (2 + np.abs(U).max(initial=0))
        if free.any() and np.abs(shown - X0 - U)[free].max() > tolerance:
            self.violated("frame", f"x of frame {frame.index} is not where the state has its particles")
        if load.grips == "soft" or not held.any():
            return
        expected = load.speed * frame.t
        along = (U @ np.asarray(load.axis)) * self.sim.state.side
        driven = held & (intact | (not s.total))
        # Each substep adds v dt to U, rounded: EPS / 2 of U a substep, in float32 a bias when v dt is tiny.
        slack = 1e-6 * expected + self.eps * self.sim.report.substeps * float(np.abs(U[held]).max())
        if driven.any() and np.abs(along[driven] - expected).max() > slack:
            off = np.abs(along[driven] - expected).max()
            self.violated("grips", f"a grip is {off:g} m away from v t = {expected:g} m at frame {frame.index}")

    def _report(self, frame: Frame) -> None:
        """Times, history and summary of the report are consistent with the frame."""
        h: History = self.sim.report.history
        expected = frame.index / self.scene.capture.fps
        if not math.isclose(frame.t, expected, rel_tol=1e-12, abs_tol=0):
            self.violated("time", f"frame {frame.index} is at {frame.t:g} s instead of {expected:g} s")
        if frame.index and not math.isclose(h.dt_t[-1], expected, rel_tol=1e-7):
            self.violated("time", f"substeps ended at {h.dt_t[-1]:.9g} s, frame {frame.index} is at {expected:.9g} s")
        rows = (h.t, h.nominal_stretch, h.load, h.stretch_max, h.damaged, h.failed, h.kinetic, h.elastic)
        if any(len(row) != frame.index + 1 for row in rows):
            self.violated("history", f"frame {frame.index} has rows of lengths {[len(row) for row in rows]}")
        try:
            json.dumps(self.sim.report.summary(), allow_nan=False)
        except ValueError as error:
            self.violated("summary", f"at frame {frame.index}: {error}")

    def _momentum_of_world(self) -> Array:
        """Momentum of the particles [N s], (3,), in the world."""
        return self.sim.lattice.vectors_to_world(momentum(self.sim.state))

    def _momentum(self, frame: Frame) -> None:
        """Momentum along the axis changes by the impulses of grips and gravity.

        Not checked with grid decay or walls, since their impulses are not tallied, nor in `total` once a particle has
        failed, since it takes its momentum off the grid.
        """
        s, m, damped = self.sim.state, self.scene.material, self.scene.solver.damping != "none"
        if frame.index == 0:  # what grips hold is in motion before the first substep, without an impulse
            self._start = self._momentum_of_world()
        failed = s.total and frame.failed.any()
        if (damped and m.decay > 0) or self.scene.solver.walls or failed:
            return
        sums, axis = s.sums(), np.asarray(self.scene.loading.axis)
        weight = float(self.mass.sum() * np.asarray(self.scene.loading.gravity) @ axis)
        impulse = sums[slot.PULL_LOW] + sums[slot.PULL_HIGH] + weight * (s.pushed if s.total else frame.t)
        off = abs(float((self._momentum_of_world() - self._start) @ axis) - impulse)
        self._largest_sum = max(self._largest_sum, self._grid_sum(frame))
        slack = (SUMMED * self.eps + NEGLIGIBLE) * (1 + self.sim.report.substeps) * self._largest_sum
        if off > slack:
            self.violated("momentum", f"off by {off:g} N s at frame {frame.index}; round-off explains {slack:g} N s")

    def _grid_sum(self, frame: Frame) -> float:
        """Sum of the magnitudes that the grid adds in a substep: momenta, affine momenta, impulses of stress [N s]."""
        s, h = self.scene, self.scene.solver.h
        dt = self.sim.report.history.dt[-1] if self.sim.report.history.dt else 0.0
        P = np.linalg.norm(frame.tau, axis=(1, 2))
        if self.sim.state.total:
            with np.errstate(all="ignore"):
                P = P / np.maximum(np.linalg.svd(frame.F, compute_uv=False)[:, 2], 1e-3)
        v = np.linalg.norm(frame.v, axis=1) + s.loading.speed + math.hypot(*s.loading.gravity) * dt
        C = np.linalg.norm(self.sim.state.points.C.to_numpy(), axis=(1, 2))
        sums = self.mass * (v + h * C) + 4 * dt / h * self.sim.report.volume * P
        return float(sums.sum(dtype=np.float64))

    def _energy(self, frame: Frame) -> None:
        """Kinetic and elastic energy plus tallied losses do not exceed the initial energy plus the tallied work.

        Not checked in scenes that are not sensible once J was clamped: the stress then is no derivative of an energy.
        """
        h, sums = self.sim.report.history, self.sim.state.sums()
        if sums[slot.CLAMPED] > 0 and not self.sensible:
            return
        work = float(sums[slot.GRIP_WORK] + sums[slot.GRAVITY_WORK])
        lost = float(sums[slot.DAMAGED] + sums[slot.RELEASED])
        lost += float(sums[slot.DECAYED]) * self._least_decay()
        lost += float(sums[slot.VISCOUS]) * self._least_viscous()
        self._gross_work += abs(work - (self._work[-1] if self._work else 0.0))
        self._work.append(work)
        put_in = self._gross_work + abs(h.kinetic[0]) + abs(h.elastic[0])
        excess = h.kinetic[-1] + h.elastic[-1] + lost - work - h.kinetic[0] - h.elastic[0]
        slack = CREATED * put_in + self._energy_round_off(put_in)
        if excess > slack:
            parts = f"kinetic {h.kinetic[-1]:.3g}, elastic {h.elastic[-1]:.3g}, lost {lost:.3g}"
            sentence = f"{excess:.3g} J from nowhere at frame {frame.index}, {put_in:.3g} J put in ({parts})"
            self.violated("energy", sentence)

    def _least_viscous(self) -> float:
        """Least part of the tallied viscous work that is really lost.

        An explicit substep that removes r of a velocity v tallies r m v^2 and loses (r - r^2 / 2) m v^2.
        """
        s, dt = self.scene, max(self.sim.report.history.dt, default=0.0)
        r = 4 * s.material.viscosity * dt / (s.material.density * s.solver.h**2)
        if s.solver.formulation == "total" or s.solver.damping == "per_substep":
            r = 2.0  # the largest that the solver accepts
        return max(1 - min(r, 2.0) / 2, 0.0)

    def _least_decay(self) -> float:
        """Least part of the tallied decay that is really lost.

        The tally adds m v^2 (1 - k^2) / 2 for a node that keeps k of its velocity. The strain follows k v: if drag
        balances the stress, the work of the stress is m v^2 k (1 - k).
        """
        dts = self.sim.report.history.dt
        k = min((damping(self.sim.state.medium, dt).keep for dt in dts), default=1.0)
        return 2 * k / (1 + k)

    def _energy_round_off(self, put_in: float) -> float:
        """Round-off of the energies [J].

        F is rounded in each substep, and strain energies are differences of numbers as large as the moduli.
        """
        m, n = self.scene.material, 1 + self.sim.report.substeps
        strain = self.eps * math.sqrt(n)
        density = (3 * m.lam + 2 * m.mu) * (strain**2 + SUMMED * self.eps)
        return float(density * self.sim.report.volume.sum()) + self.eps * n * put_in
