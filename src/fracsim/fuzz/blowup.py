"""The fixed substep at which a small perturbation grows, beside the stability bound that `dt: auto` would use."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from rich.table import Table

from fracsim import registry
from fracsim.lab.stage import free, lattice, medium, ordered, particles
from fracsim.mpm.drive import Drive
from fracsim.mpm.grips import Grips
from fracsim.mpm.medium import Medium
from fracsim.mpm.state import State
from fracsim.mpm.timestep import stable
from fracsim.records import Array, Particles
from fracsim.scene.vocab import CENTRE, Fracture, Material, Solver

CELLS, E, DENSITY = 50, 1e4, 200.0
STEPS, GROWN, NUDGE = 600, 1e-3, 1e-6
"""A perturbation of size NUDGE has grown when it is larger than GROWN after STEPS."""
RESOLVED = 1.003
"""Bisection ends at this ratio of a substep that blows up to one that does not."""
TIGHT = 1.15
"""The blow-up of an isolated particle is at most this many times the bound."""
OBJECTS = ("particle", "block", "stretched")
"""An isolated particle; a free block of 4^3 cells, at rest; one at stretch 2, held at its ends, free to contract."""


@dataclass(frozen=True)
class Setting:
    """What is pushed until it blows up."""

    law: str
    nu: float
    formulation: str
    rpic: float
    """Viscosity as the r of RPIC damping at the stability bound without it."""
    object: str


SETTINGS = [
    Setting(*values)
    for values in product(registry.names("fracsim.constitutive"), (0.1, 0.3, 0.49), ("total", "updated"), (0.0, 0.5),
                          OBJECTS)
]  # fmt: skip


@dataclass(frozen=True)
class Row:
    """A setting, its bound [s], and the substep at which it blows up [s]."""

    setting: Setting
    bound: float
    blowup: float

    @property
    def ratio(self) -> float:
        """Blow-up over bound."""
        return self.blowup / self.bound

    @property
    def kept(self) -> bool:
        """Whether the bound is safe, and tight where it has to be."""
        return 1 <= self.ratio <= (TIGHT if self.setting.object == "particle" else math.inf)


def measure(setting: Setting) -> Row:
    """Bisect the blow-up of a setting; the smallest substep that was seen to blow up."""
    state, F = _prepare(setting)
    bound = stable(state.medium, _stiffness(state, F))
    low, high = 0.5 * bound, 4 * bound
    while high / low > RESOLVED:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if _grows(state, F, middle) else (middle, high)
    return Row(setting, bound, high)


def _medium(setting: Setting) -> Medium:
    """The medium of a setting, in float64."""
    solver = Solver(cells=CELLS, precision="float64", formulation=setting.formulation)
    plain = Material(law=setting.law, E=E, nu=setting.nu, density=DENSITY)
    dt = solver.h * math.sqrt(DENSITY / (3 * plain.lam + 2 * plain.mu))
    viscosity = setting.rpic * DENSITY * solver.h**2 / (4 * dt)
    return medium(solver, replace(plain, viscosity=viscosity), Fracture(onset=8, crit=9))


def _prepare(setting: Setting) -> tuple[State, Array]:
    """A state in equilibrium and its deformation gradients, (N, 3, 3)."""
    solid = _medium(setting)
    h, spacing = solid.h, solid.solver.spacing
    if setting.object == "stretched":
        return _stretched(solid)
    X = ordered(lattice((4 * h,) * 3, spacing), h) if setting.object == "block" else np.array([[1.003, 1.005, 0.998]])
    state = free(solid, particles(X.astype(np.float32), spacing))
    return state, np.tile(np.eye(3), (state.n, 1, 1))


def _stretched(solid: Medium) -> tuple[State, Array]:
    """A bar of 4 x 4 cells, stretched to twice its length, whose ends are held; its sides carry no stress.

    In `updated` the particles are where the stretch has brought them, four a cell along the bar at rest: with two the
    grid parts them here, whatever the substep.
    """
    h, spacing = solid.h, solid.solver.spacing
    ends = Grips("rigid", (1.0, 0.0, 0.0), offset=4.5 * h, thickness=5 * h, speed=0.0, h=h)
    bar = particles(ordered(lattice((10 * h, 4 * h, 4 * h), spacing), h), spacing)
    side = _sides(State(solid, bar, ends, Drive("serial")))
    F = np.diag([2.0, side, side])
    state = State(solid, bar if solid.total else _moved(bar, side), ends, Drive("serial"))
    return state, np.tile(F, (state.n, 1, 1))


def _moved(bar: Particles, side: float) -> Particles:
    """A bar as long as this one, now stretched to it from half its length, where it had twice the particles."""
    X = np.asarray(CENTRE) + (bar.X - np.asarray(CENTRE)) * [1.0, side, side]
    body = particles(X.astype(np.float32), bar.spacing)
    return replace(body, volume=body.volume / 2)


def _sides(state: State) -> float:
    """The stretch across of a bar at stretch 2 without stress on its sides, by bisection."""
    low, high = 0.3, 1.2
    for _ in range(60):
        middle = (low + high) / 2
        state.points.F.from_numpy(np.tile(np.diag([2.0, middle, middle]), (state.n, 1, 1)))
        low, high = (middle, high) if state.observe().tau[0, 1, 1] < 0 else (low, middle)
    return low


def _stiffness(state: State, F: Array) -> float:
    """The largest stiffness bound as `dt: auto` sees it."""
    state.points.F.from_numpy(F)
    return state.survey().stiffness


def _grows(state: State, F: Array, dt: float) -> bool:
    """Whether a random perturbation of F has grown, by which time the state is far from equilibrium."""
    rng = np.random.default_rng(0)
    state.points.F.from_numpy(F + NUDGE * rng.normal(size=F.shape))
    state.points.V.from_numpy(np.zeros((state.n, 3)))
    state.first_substep = True  # nodes forget how they moved
    state.points.C.from_numpy(np.zeros((state.n, 3, 3)))
    state.points.U.from_numpy(np.zeros((state.n, 3)))
    state.points.D.from_numpy(np.zeros(state.n))
    state.clear_fault()  # whatever the last blow-up left there
    state.run(STEPS, dt, 0.0)
    return not np.abs(state.points.F.to_numpy() - F).max() < GROWN


def table(rows: Iterable[Row]) -> Table:
    """Ratios of blow-up to bound: a line a material, a column an object."""
    out = Table("law", "nu", "formulation", "r", title="blow-up substep / stability bound")
    for name in OBJECTS:
        out.add_column(name, justify="right")
    groups: dict[tuple[str, float, str, float], dict[str, Row]] = {}
    for row in rows:
        s = row.setting
        groups.setdefault((s.law, s.nu, s.formulation, s.rpic), {})[s.object] = row
    for (law, nu, form, rpic), group in groups.items():
        shown = [_coloured(group[name]) if name in group else "" for name in OBJECTS]
        out.add_row(law, f"{nu:g}", form, f"{rpic:g}", *shown)
    return out


def _coloured(row: Row) -> str:
    return f"[{'green' if row.kept else 'red'}]{row.ratio:.3f}[/]"
