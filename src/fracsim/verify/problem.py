"""Verification problems: their settings, their checks, and how they are run."""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from fracsim import registry
from fracsim.scene.program import compose
from fracsim.scene.vocab import H0, Solver

PACKAGE = "fracsim.verify.problems"
FORMULATIONS = ("total", "updated")


@dataclass(frozen=True)
class Check:
    """One quantity, its exact and its measured value."""

    quantity: str
    exact: float
    """Closed form or independent solution; NaN if there is none."""
    measured: float
    error: float
    """As defined by the constructor: relative, absolute, or the amount below a bound. NaN without an exact value."""
    tolerance: float | None = None
    """Largest error that meets the target; None for a figure without one."""
    unit: str = "1"
    axis: str = ""
    """The refined quantity of a convergence study, `h` or `dt`; else empty."""
    at: float = math.nan
    """Value of the refined quantity [m or s]."""
    problem: str = ""
    formulation: str = ""
    seconds: float = 0.0
    """Time since the previous check of the same problem."""

    @property
    def ok(self) -> str:
        """`yes` or `no`; empty without a tolerance."""
        if self.tolerance is None:
            return ""
        return "yes" if self.error <= self.tolerance else "no"


def relative(quantity: str, exact: float, measured: float, tolerance: float | None = None, **more: Any) -> Check:
    """A check whose error is |measured - exact| / |exact|."""
    return Check(quantity, exact, measured, abs(measured - exact) / abs(exact), tolerance, **more)


def absolute(quantity: str, exact: float, measured: float, tolerance: float | None = None, **more: Any) -> Check:
    """A check whose error is |measured - exact|."""
    return Check(quantity, exact, measured, abs(measured - exact), tolerance, **more)


def at_least(quantity: str, bound: float, measured: float, **more: Any) -> Check:
    """A check that a figure is not below a bound; the error is the amount below it."""
    short = bound - measured if measured < bound or math.isnan(measured) else 0.0
    return Check(quantity, bound, measured, short, 0.0, **more)


def reported(quantity: str, measured: float, unit: str = "1", **more: Any) -> Check:
    """A figure without an exact value."""
    return Check(quantity, math.nan, measured, math.nan, None, unit, **more)


@dataclass(frozen=True)
class Setting:
    """The solver of a problem: the fields of a quality preset, a formulation, and the problem's own cells."""

    preset: Solver
    formulation: str
    quick: bool = False
    """Small sizes and few refinements."""

    def solver(self, cells: float, particles_per_axis: float = 2.0) -> Solver:
        """The preset on `cells` cells along 2 m. A fixed dt is that of 2/150 m, scaled to keep its Courant number."""
        cells, dt = round(cells), self.preset.dt
        if not isinstance(dt, str):
            dt *= (2 / cells) / H0
        return replace(self.preset, cells=cells, particles_per_axis=particles_per_axis, dt=dt, dt_override=True,
                       formulation=self.formulation, walls=False)  # fmt: skip

    @property
    def single(self) -> bool:
        """Whether the simulation is in float32."""
        return self.preset.precision == "float32"

    def by_precision(self, float32: float, float64: float) -> float:
        """The tolerance of the precision in use."""
        return float32 if self.single else float64


def preset(quality: str) -> Solver:
    """The solver fields of conf/quality/`quality`.yaml."""
    return compose(f"quality={quality}").solver


def names() -> tuple[str, ...]:
    """The names of all problems."""
    return registry.names(PACKAGE)


def suits(name: str, formulation: str) -> bool:
    """Whether a problem can be run in a formulation."""
    module = registry.load(PACKAGE, name, "--only")
    return formulation in getattr(module, "FORMULATIONS", FORMULATIONS)


def run(name: str, setting: Setting) -> Iterator[Check]:
    """The checks of one problem, with its name and their times. A RuntimeError becomes a missed check."""
    since = time.perf_counter()
    try:
        for check in registry.load(PACKAGE, name, "--only").run(setting):
            now = time.perf_counter()
            yield replace(check, problem=name, formulation=setting.formulation, seconds=now - since)
            since = time.perf_counter()
    except RuntimeError as error:
        failed = Check(f"failed: {error}"[:80], math.nan, math.nan, math.inf, 0.0)
        yield replace(failed, problem=name, formulation=setting.formulation, seconds=time.perf_counter() - since)
