"""A bar stretched with held sides: F = diag(lambda, 1, 1)."""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import advance, bar, flat, free, medium, particles, put
from fracsim.mpm.drive import Drive
from fracsim.mpm.grips import Grips
from fracsim.mpm.state import State
from fracsim.scene.vocab import Loading, Material
from fracsim.solve.report import EnergyTally
from fracsim.verify.problem import Check, Setting, relative
from fracsim.verify.pull import PLACES

E, STRETCH = 2e3, 1.5
CASES = (("fixed_corotated", 0.3), ("neo_hookean", 0.45))


def kirchhoff(law: str, mu: float, lam: float, l: float) -> tuple[float, float]:
    """tau11 and tau22 [Pa] at F = diag(l, 1, 1)."""
    if law == "fixed_corotated":
        return 2 * mu * (l**2 - l) + lam * l * (l - 1), lam * l * (l - 1)
    return mu * (l**2 - 1) + lam * np.log(l), lam * np.log(l)


def prescribed(setting: Setting, material: Material) -> tuple[float, float]:
    """tau11 and tau22 [Pa] computed by the solver at F = diag(STRETCH, 1, 1)."""
    solver = setting.solver(20)
    body = bar(solver)
    state = free(medium(solver, material), body)
    put(state, F=np.diag([STRETCH, 1, 1]))
    tau = state.observe()[0].astype(float).mean(axis=0)
    return float(tau[0, 0]), float(tau[1, 1])


def pulled(setting: Setting, material: Material, gauge: float) -> tuple[float, float, float]:
    """Final stretch of the middle of a pulled bar; mean stretch and load / section [Pa] over the last twentieth.

    The grips slide and are `gauge` cells apart. The mean stretch is that of both ends of the last twentieth.
    """
    solver = setting.solver(50)
    h, speed = solver.h, 0.01 * np.sqrt(material.E / material.density)
    X = np.stack([1 + (np.arange(42) - 20.5) * h / 2, np.ones(42), np.ones(42)], axis=1)
    pull = Loading(offset=(gauge / 2 + 1) * h, thickness=2 * h, speed=speed, grips="sliding")
    grips = Grips(pull.grips, pull.axis, pull.offset, pull.thickness, pull.speed, h)
    state = State(medium(solver, material), particles(X, h / 2), grips, Drive("serial"))
    end, middle = (STRETCH - 1) * gauge * h / (2 * speed), np.abs(state.X0[:, 0]) < 2 * h
    stretch, impulse = [], []
    for start, duration in ((0.0, 0.95 * end), (0.95 * end, 0.05 * end)):
        advance(state, duration, start, flat(state, (1, 2)))
        stretch.append(float(state.points.F.to_numpy()[middle, 0, 0].mean()))
        impulse.append(EnergyTally.of(state.sums()).impulse)
    return stretch[-1], float(np.mean(stretch)), (impulse[1] - impulse[0]) / (0.05 * end) / (h / 2) ** 2


def run(setting: Setting) -> Iterator[Check]:
    """The law at a prescribed F; final stretch of the middle of a pulled bar, and load at that stretch."""
    for law, nu in CASES:
        material = Material(law=law, E=E, nu=nu)
        exact = kirchhoff(law, material.mu, material.lam, STRETCH)
        for name, should, found in zip(("tau11", "tau22"), exact, prescribed(setting, material), strict=True):
            yield relative(f"{law} {name}, prescribed", should, found, setting.by_precision(2e-5, 1e-6), unit="Pa")
        runs = [pulled(setting, material, 16 + 2 * place) for place in PLACES]
        middle = np.array([end for end, _, _ in runs]) / STRETCH
        load = np.array([load * l / kirchhoff(law, material.mu, material.lam, l)[0] for _, l, load in runs])
        for name, ratios in (("stretch of the middle", middle), ("load / section at that stretch", load)):
            worst = ratios[np.abs(ratios - 1).argmax()]
            yield relative(f"{law} {name} / exact, worst of {len(PLACES)} places of the grips", 1, float(worst), 0.01)
