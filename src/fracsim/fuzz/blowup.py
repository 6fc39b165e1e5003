"""The smallest fixed substep at which a small perturbation grows, compared with the stability bound of `dt: auto`."""

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
"""Cells along 2 m, Young's modulus [Pa], density [kg/m^3]."""
STEPS, GROWN, NUDGE = 600, 1e-3, 1e-6
"""A perturbation of F of size NUDGE has grown if it exceeds GROWN after STEPS substeps."""
RESOLVED = 1.003
"""Bisection ends at this ratio of a substep that blows up to one that does not."""
TIGHT = 1.15
"""Largest ratio of blow-up to bound of an isolated particle."""
OBJECTS = ("particle", "block", "stretched")
"""An isolated particle; a free block of 4^3 cells at rest; a bar at stretch 2 with held ends and free sides."""


@dataclass(frozen=True)
class Setting:
    """A material, a formulation and an object whose blow-up is measured."""

    law: str
    nu: float
    formulation: str
    rpic: float
    """Viscosity, as the r of RPIC damping at the stability bound of the undamped solid."""
    object: str
    """One of `OBJECTS`."""


SETTINGS = [
    Setting(*values)
    for values in product(registry.names("fracsim.constitutive"), (0.1, 0.3, 0.49), ("total", "updated"), (0.0, 0.5),
                          OBJECTS)
]  # fmt: skip


@dataclass(frozen=True)
class Margin:
    """A setting, its stability bound [s], and the smallest substep that blows up [s]."""

    setting: Setting
    bound: float
    blowup: float

    @property
    def ratio(self) -> float:
        """Blow-up over bound."""
        return self.blowup / self.bound

    @property
    def kept(self) -> bool:
        """Whether the bound is safe, and for an isolated particle also tight."""
        return 1 <= self.ratio <= (TIGHT if self.setting.object == "particle" else math.inf)


def measure(setting: Setting) -> Margin:
    """Find the smallest substep that blows up by bisection."""
    state, F = _prepare(setting)
    bound = stable(state.medium, _stiffness(state, F))
    low, high = 0.5 * bound, 4 * bound
    while high / low > RESOLVED:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if _grows(state, F, middle) else (middle, high)
    return Margin(setting, bound, high)


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
    """A bar of 4 x 4 cells in section, stretched to twice its length between held ends, and its F, (N, 3, 3).

    Its sides carry no stress. In `updated` the particles are in their stretched positions, and there are four a cell
    along the bar at rest: with two the grid would part them at any substep.
    """
    h, spacing = solid.h, solid.solver.spacing
    ends = Grips("rigid", (1.0, 0.0, 0.0), offset=4.5 * h, thickness=5 * h, speed=0.0, h=h)
    bar = particles(ordered(lattice((10 * h, 4 * h, 4 * h), spacing), h), spacing)
    side = _sides(State(solid, bar, ends, Drive("serial")))
    F = np.diag([2.0, side, side])
    state = State(solid, bar if solid.total else _contracted(bar, side), ends, Drive("serial"))
    return state, np.tile(F, (state.n, 1, 1))


def _contracted(bar: Particles, side: float) -> Particles:
    """The bar as if stretched to its present length from half of it: sides contracted by `side`, volumes halved."""
    X = np.asarray(CENTRE) + (bar.X - np.asarray(CENTRE)) * [1.0, side, side]
    body = particles(X.astype(np.float32), bar.spacing)
    return replace(body, volume=body.volume / 2)


def _sides(state: State) -> float:
    """Lateral stretch of a bar at stretch 2 with free sides, by bisection."""
    low, high = 0.3, 1.2
    for _ in range(60):
        middle = (low + high) / 2
        state.points.F.from_numpy(np.tile(np.diag([2.0, middle, middle]), (state.n, 1, 1)))
        low, high = (middle, high) if state.observe().tau[0, 1, 1] < 0 else (low, middle)
    return low


def _stiffness(state: State, F: Array) -> float:
    """The largest stiffness bound [Pa] of the particles at F, (N, 3, 3), as `dt: auto` computes it."""
    state.points.F.from_numpy(F)
    return state.survey().stiffness


def _grows(state: State, F: Array, dt: float) -> bool:
    """Whether a random perturbation of F, (N, 3, 3), has grown after STEPS substeps of dt [s].

    Afterwards the state is far from equilibrium.
    """
    rng = np.random.default_rng(0)
    state.points.F.from_numpy(F + NUDGE * rng.normal(size=F.shape))
    state.points.V.from_numpy(np.zeros((state.n, 3)))
    state.first_substep = True  # nodes have no velocity yet
    state.points.C.from_numpy(np.zeros((state.n, 3, 3)))
    state.points.U.from_numpy(np.zeros((state.n, 3)))
    state.points.D.from_numpy(np.zeros(state.n))
    state.clear_fault()  # of the previous blow-up
    state.run(STEPS, dt, 0.0)
    return not np.abs(state.points.F.to_numpy() - F).max() < GROWN


def table(margins: Iterable[Margin]) -> Table:
    """Ratios of blow-up to bound: one line for each material and formulation, one column for each object."""
    out = Table("law", "nu", "formulation", "r", title="blow-up substep / stability bound")
    for name in OBJECTS:
        out.add_column(name, justify="right")
    groups: dict[tuple[str, float, str, float], dict[str, Margin]] = {}
    for margin in margins:
        s = margin.setting
        groups.setdefault((s.law, s.nu, s.formulation, s.rpic), {})[s.object] = margin
    for (law, nu, form, rpic), group in groups.items():
        shown = [_coloured(group[name]) if name in group else "" for name in OBJECTS]
        out.add_row(law, f"{nu:g}", form, f"{rpic:g}", *shown)
    return out


def _coloured(margin: Margin) -> str:
    return f"[{'green' if margin.kept else 'red'}]{margin.ratio:.3f}[/]"
