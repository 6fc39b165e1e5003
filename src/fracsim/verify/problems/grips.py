"""What the grips do to a stiff bar: rigid ones move by v t, soft ones slip as a dashpot does."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp

from fracsim.lab.stage import NEVER, bar
from fracsim.scene.vocab import Backend, Capture, Loading, Material, Scene
from fracsim.solve.simulator import Simulator
from fracsim.verify.closed_form import uniaxial
from fracsim.verify.problem import Check, Setting, absolute, relative

LAW, E, NU, DENSITY = "neo_hookean", 1e5, 0.45, 200.0
SPEED, GAUGE, CELLS = 0.6, 16, 50
"""Of each grip [m/s]; between their faces, in cells of 2 / CELLS m; a grip is two cells thick."""
STALL = 0.6
"""The substep is such that soft grips stall at the nominal stress STALL * E."""


def slipping(duration: float, gauge: float) -> tuple[float, float]:
    """Stretch, and displacement of a grip / (v t), when particles alone are told to move at v.

    A grip of thickness s gets the impulse rho s (v - u) a section and substep, so that the load P is dt P / (rho s)
    short of v: d lambda / dt = 2 (v - dt P(lambda) / (rho s)) / L0 with rho s v / dt = STALL E.
    """

    def rate(t: float, stretch: list[float]) -> list[float]:
        return [2 * SPEED * (1 - uniaxial(LAW, NU, stretch[0])[0] / STALL) / gauge]

    stretch = float(solve_ivp(rate, (0, duration), [1.0], rtol=1e-8).y[0, -1])
    return stretch, (stretch - 1) * gauge / (2 * SPEED * duration)


def pulled(setting: Setting, grips: str, duration: float) -> tuple[float, float]:
    """Mean displacement of the held particles / (v t), and stretch of the middle."""
    solver = setting.solver(CELLS)
    h = solver.h
    if grips == "soft":
        solver = replace(solver, dt=DENSITY * 2 * h * SPEED / (STALL * E))
    load = Loading(offset=(GAUGE / 2 + 1) * h, thickness=2 * h, speed=SPEED, grips=grips)
    scene = Scene(solver=solver, material=Material(law=LAW, E=E, nu=NU, density=DENSITY), fracture=NEVER, loading=load,
                  backend=Backend(threads=1), capture=Capture(frames=21, fps=20 / duration))  # fmt: skip
    simulator = Simulator(scene, bar(solver, ((GAUGE + 4) * h, 4 * h, 4 * h)))
    *_, last = simulator.frames()
    held = simulator.state.side != 0
    moved = float((simulator.state.side * simulator.state.points.U.to_numpy()[:, 0].astype(float))[held].mean())
    middle = np.abs(simulator.particles.X[:, 0] - 1) < 2 * h
    return moved / (SPEED * duration), float(np.linalg.svd(last.F[middle], compute_uv=False)[:, 0].mean())


def run(setting: Setting) -> Iterator[Check]:
    """Rigid for a short pull; soft until they have slipped through most of theirs."""
    gauge = GAUGE * 2 / CELLS
    way = pulled(setting, "rigid", 0.5 * gauge / (2 * SPEED))[0]
    yield absolute("rigid: displacement / (v t)", 1, way, 1e-4)
    duration = (0.8 if setting.quick else 2.36) * gauge / (2 * SPEED)
    stretch, slipped = slipping(duration, gauge)
    way, middle = pulled(setting, "soft", duration)
    yield relative("soft: displacement / (v t)", slipped, way, 0.15)
    yield relative("soft: stretch of the middle", stretch, middle, 0.15)
