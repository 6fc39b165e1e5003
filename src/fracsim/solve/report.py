"""What is counted during a run: history over frames, energy balance, and warnings."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fracsim.mpm import params as slot
from fracsim.mpm.medium import Medium
from fracsim.records import Array, Frame, Particles
from fracsim.scene.vocab import CENTRE, Scene

CRUSHED = 1e-5
"""Warn above this fraction of crushed particle-substeps. At a crack some particles are crushed that have nearly failed;
the report has the count in any case."""
TEARING = 0.9
"""In `updated` the grid lets go of particles that are this many cells apart, whatever their damage."""


def failure_distance(medium: Medium, particles: Particles) -> float:
    """Distance of neighbours along the pull, in cells, when the material reaches lambda_crit."""
    return medium.fracture.crit * particles.spacing / medium.h


@dataclass(frozen=True)
class EnergyTally:
    """Sums over time at one instant in SI units; works and losses in J, impulses in N s."""

    impulse: float
    """Of both grips, outwards, mean of the two."""
    grip_work: float
    decayed: float
    projected: float
    viscous: float
    damaged: float
    released: float
    gravity_work: float

    @classmethod
    def of(cls, sums: Array) -> "EnergyTally":
        """From the sums of `State.sums`, (SUMS,)."""
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


@dataclass(frozen=True)
class Seen:
    """What a frame shows besides its arrays; all energies at the instant of the velocities."""

    tally: EnergyTally
    energy: Array
    """Strain energy densities, (1 - d) psi [Pa], (N,)."""
    stretch: float
    """Largest stretch of a particle."""
    kinetic: float
    """Kinetic energy [J]."""
    load: float
    """Tension between the grips [N]."""


class Report:
    """Collects `History` and the facts of the final table."""

    def __init__(self, scene: Scene, medium: Medium, particles: Particles, exempt: Array, warnings: list[str]) -> None:
        """`exempt`, (N,) bool, are the particles that gather no damage; `warnings` are known before the run."""
        self.scene, self.medium = scene, medium
        self.warnings = [*particles.notes, *warnings]
        self.mass = particles.volume.astype(np.float64) * scene.material.density
        self.volume = particles.volume.astype(np.float64)
        self.free = ~exempt
        self._warn_before(particles)
        self.history, self.tally = History(), EnergyTally(*([0.0] * 8))
        self.substeps = self.clamped = 0
        self.crumbled = 0.0
        self.capped = 0
        """Most intact particles of a frame that are shown with less than their stretch, lambda_crit."""
        self.break_frame: int | None = None
        self.torn_frame: int | None = None
        self.settled_frame: int | None = None
        self.stretch_max = 1.0
        self.expected = math.nan

    def _warn_before(self, particles: Particles) -> None:
        """Warnings that follow from scene and object alone."""
        scene, crit, distance = self.scene, self.medium.fracture.crit, failure_distance(self.medium, particles)
        if scene.solver.formulation == "updated" and distance > TEARING:
            needed, near = math.ceil(crit / 0.85), TEARING / distance * crit
            self.warnings.append(
                f"solver.formulation=updated tears numerically near a stretch of {near:.2f}, "
                f"before fracture.crit={crit:g}: use total, or solver.particles_per_axis={needed}"
            )
        s = (particles.X.astype(np.float64) - CENTRE) @ np.asarray(scene.loading.axis)
        if not self.free[np.abs(s) < scene.loading.offset].any():
            self.warnings.append(
                "nothing between the grips can tear: no particle lies there that they do not hold; use a larger "
                "loading.offset, more solver.cells or fracture.at_grips=true"
            )

    @property
    def parted(self) -> bool:
        """Whether the object no longer holds together."""
        return self.break_frame is not None or self.torn_frame is not None

    def advanced(self, n: int, dt: float, t: float) -> None:
        """Count n substeps of length dt that ended at t."""
        self.substeps += n
        self.history.dt_t.append(t)
        self.history.dt.append(dt)

    def add(self, frame: Frame, seen: Seen, verdict: str) -> None:
        """Add a frame, what was seen of it, and whether the object has parted: `whole`, `broken` or `torn`."""
        h, loading = self.history, self.scene.loading
        self.stretch_max = max(self.stretch_max, seen.stretch)
        h.t.append(frame.t)
        h.nominal_stretch.append(1 + 2 * loading.speed * frame.t / loading.gauge)
        h.load.append(seen.load)
        h.stretch_max.append(seen.stretch)
        h.damaged.append(float((frame.d > 0).mean()))
        h.failed.append(float(frame.failed.mean()))
        h.kinetic.append(seen.kinetic)
        h.elastic.append(float((seen.energy * self.volume).sum()))
        self.tally = seen.tally
        if verdict == "broken":
            self.break_frame = frame.index
        elif verdict == "torn":
            self.torn_frame = frame.index

    def energy(self) -> dict[str, float]:
        """Where the work went [J].

        `projection` is lost in projecting velocities on particles, `released` is what failed particles took along, and
        `unaccounted` the rest: the error of the time integration. Velocities are those of half a substep before a
        frame, and so are all energies.
        """
        h, b = self.history, self.tally
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
            "lambda_crit": self.medium.fracture.crit,
            "particles": len(self.mass),
            "stretch_max": self.stretch_max,
            "damaged": h.damaged[-1],
            "failed": h.failed[-1],
            "peak_load": max(h.load),
            "substeps": self.substeps,
            "dt_min": min(h.dt, default=0.0),
            "dt_max": max(h.dt, default=0.0),
            "clamped": self.clamped,
            "exempt_from_damage": int((~self.free).sum()),
            "shown_capped": self.capped,
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
