"""What is counted during a run: history over frames, energy balance, faults and warnings."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fracsim.mpm import params as slot
from fracsim.mpm.grips import along
from fracsim.records import Array, Frame, Particles
from fracsim.scene.vocab import Scene

CRUSHED = 1e-5
"""Part of all substeps of all particles that may be crushed unmentioned: at a crack, some particles that are nearly
failed are. The count is in the report in any case."""
TEARING = 0.9
"""In `updated` the grid lets go of particles that are this many cells apart, whatever their damage."""


def failure_reach(scene: Scene, particles: Particles) -> float:
    """Distance of neighbours along the pull, in cells, when the material reaches lambda_crit."""
    return scene.fracture.crit * particles.spacing / scene.solver.h


@dataclass(frozen=True)
class Books:
    """Running sums of one instant in SI units; works and losses in J, impulses in N s."""

    impulse: float
    """Pull of both grips, outwards, mean of the two."""
    grip_work: float
    decayed: float
    projected: float
    viscous: float
    damaged: float
    released: float
    gravity_work: float

    @classmethod
    def of(cls, sums: Array) -> "Books":
        """From the sums of `State.booked`."""
        pull = (sums[slot.PULL_HIGH] - sums[slot.PULL_LOW]) / 2
        names = (
            slot.GRIP_WORK,
            slot.DECAYED,
            slot.PROJECTED,
            slot.VISCOUS,
            slot.DAMAGED,
            slot.RELEASED,
            slot.GRAVITY_WORK,
        )
        return cls(float(pull), *(float(sums[k]) for k in names))


@dataclass
class History:
    """One number a frame; `dt_t` and `dt` one a round of substeps."""

    t: list[float] = field(default_factory=list)
    nominal_stretch: list[float] = field(default_factory=list)
    load: list[float] = field(default_factory=list)
    stretch_max: list[float] = field(default_factory=list)
    damaged: list[float] = field(default_factory=list)
    failed: list[float] = field(default_factory=list)
    kinetic: list[float] = field(default_factory=list)
    elastic: list[float] = field(default_factory=list)
    dt_t: list[float] = field(default_factory=list)
    dt: list[float] = field(default_factory=list)


class Report:
    """Collects `History` and the facts of the final table."""

    def __init__(self, scene: Scene, particles: Particles, tag: Array, warnings: list[str]) -> None:
        self.scene, self.warnings = scene, [*particles.notes, *warnings]
        reach = failure_reach(scene, particles)
        if scene.solver.formulation == "updated" and reach > TEARING:
            needed, near = math.ceil(scene.fracture.crit / 0.85), TEARING / reach * scene.fracture.crit
            self.warnings.append(
                f"solver.formulation=updated tears numerically near a stretch of {near:.2f}, "
                f"before fracture.crit={scene.fracture.crit:g}: use total, or solver.particles_per_axis={needed}"
            )
        self.mass = particles.volume.astype(np.float64) * scene.material.density
        self.volume = particles.volume.astype(np.float64)
        self.exempt = int((tag >= slot.EXEMPT).sum())
        self.free = tag < slot.EXEMPT
        between = np.abs(along(scene.loading, particles.X)) < scene.loading.offset
        if not self.free[between].any():
            self.warnings.append(
                "nothing between the grips can tear: it is within 1.5 h of what they move and gathers no damage; use a "
                "larger loading.offset, more solver.cells or fracture.at_grips=true"
            )
        self.history, self.books = History(), Books(*([0.0] * 8))
        self.substeps = self.clamped = 0
        self.crumbled = 0.0
        self.break_frame: int | None = None
        self.torn_frame: int | None = None
        self.settled_frame: int | None = None
        self.stretch_max = 1.0
        self.expected = math.nan

    @property
    def parted(self) -> bool:
        """Whether the object no longer holds together."""
        return self.break_frame is not None or self.torn_frame is not None

    def advanced(self, n: int, dt: float, t: float) -> None:
        """Count n substeps of length dt that ended at t."""
        self.substeps += n
        self.history.dt_t.append(t)
        self.history.dt.append(dt)

    def frame(self, frame: Frame, books: Books, energy: Array, stretch: float, kinetic: float, verdict: str) -> None:
        """Add a frame; `energy` is the strain energy density (N,), `stretch` the largest one, `kinetic` in J. Both
        energies are those of the instant of the velocities."""
        h, load = self.history, self.scene.loading
        self.stretch_max = max(self.stretch_max, stretch)
        h.t.append(frame.t)
        h.nominal_stretch.append(1 + 2 * load.speed * frame.t / load.gauge)
        h.load.append((books.impulse - self.books.impulse) * self.scene.capture.fps)
        h.stretch_max.append(stretch)
        h.damaged.append(float((frame.d > 0).mean()))
        h.failed.append(float(frame.failed.mean()))
        h.kinetic.append(kinetic)
        h.elastic.append(float((energy * self.volume).sum()))
        self.books = books
        if verdict == "broken":
            self.break_frame = frame.index
        elif verdict == "torn":
            self.torn_frame = frame.index

    def energy(self) -> dict[str, float]:
        """Where the work went [J].

        `projection` is lost in projecting velocities on particles, `released` is what failed particles took along, and
        `unaccounted` what no book explains: the error of the time integration. Velocities are those of half a substep
        before a frame, and so are all energies.
        """
        h, b = self.history, self.books
        spent = {
            "kinetic": h.kinetic[-1] - h.kinetic[0],
            "elastic": h.elastic[-1] - h.elastic[0],
            "damage": b.damaged,
            "viscous": b.viscous,
            "grid_decay": b.decayed,
            "released": b.released + self.crumbled,
            "projection": b.projected,
        }
        work = b.grip_work + b.gravity_work
        return {"grip_work": b.grip_work, "gravity_work": b.gravity_work, **spent,
                "unaccounted": work - sum(spent.values())}  # fmt: skip

    def summary(self) -> dict[str, Any]:
        """Plain numbers and strings for meta.json and the final table."""
        h = self.history
        return {
            "break_frame": self.break_frame,
            "torn_frame": self.torn_frame,
            "settled_frame": self.settled_frame,
            "uniform_bar_breaks_at": self.expected,
            "lambda_crit": self.scene.fracture.crit,
            "particles": len(self.mass),
            "stretch_max": self.stretch_max,
            "damaged": h.damaged[-1],
            "failed": h.failed[-1],
            "peak_load": max(h.load),
            "substeps": self.substeps,
            "dt_min": min(h.dt, default=0.0),
            "dt_max": max(h.dt, default=0.0),
            "clamped": self.clamped,
            "exempt_from_damage": self.exempt,
            "energy": self.energy(),
            "warnings": [*self.warnings, *self._findings()],
        }

    def _findings(self) -> list[str]:
        """Warnings that follow from what happened."""
        s, found = self.scene, []
        if self.torn_frame is not None:
            found.append(
                f"numerically torn at frame {self.torn_frame}: the grid parted intact material "
                f"(largest stretch {self.stretch_max:.2f}, fracture.onset={s.fracture.onset:g}); "
                "use solver.formulation=total or more solver.particles_per_axis"
            )
        if self.settled_frame is not None:
            found.append(f"settled at frame {self.settled_frame}: from then on pieces move rigidly with their grips")
        share = self.clamped / max(len(self.volume) * self.substeps, 1)
        if share > CRUSHED:
            found.append(
                f"J < 0.05 in {100 * share:.2g} % of all substeps of all particles, where the stress takes it for 0.05 "
                "and energy is off: use a smaller fracture.crit or loading.speed, or solver.dt=auto"
            )
        return found

    def fault(self, kind: int, p: int, frame: int, step: int, x: Array, v: Array) -> str:
        """The message for a fault of particle p."""
        where = f"frame {frame}, substep {step}, particle {p} at {x.round(3)} m"
        if kind == slot.GRID_FAULT:
            return (
                f"{where} left the grid (field x): it flew off, or the motion is larger than the grid. "
                "Use solver.formulation=total, or fewer capture.frames."
            )
        limit, material = self.scene.solver.max_speed, self.scene.material
        what = f"v = {np.linalg.norm(v):.3g} m/s exceeds solver.max_speed={limit:g}"
        wave = math.sqrt(material.E / material.density)
        if np.isfinite(v).all() and wave > limit / 2 and self.scene.solver.dt == "auto":
            return f"{where}: field {what}, but this material's waves run at {wave:.3g} m/s: raise solver.max_speed."
        return (
            f"{where}: field {what if np.isfinite(v).all() else 'v is not finite'}. The simulation is unstable, "
            "likely because the substep is too long: use solver.dt=auto or a smaller solver.safety."
        )
