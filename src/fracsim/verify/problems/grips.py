"""Grips on a stiff bar: rigid grips move by v t, soft grips slip like a dashpot."""

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
"""Speed of each grip [m/s], gauge length [cells of 2 / CELLS m], cells along 2 m. A grip is two cells thick."""
STALL = 0.6
"""Nominal stress / E at which soft grips stall, set by the choice of the substep."""


def slipping(duration: float, gauge: float) -> tuple[float, float]:
    """Stretch of the bar, and displacement of a soft grip / (v t), after `duration` [s] at gauge length `gauge` [m].

    In each substep a grip of thickness s and velocity u gets the impulse rho s (v - u) per area. Under the nominal
    stress P its velocity is v - dt P / (rho s): d lambda / dt = 2 (v - dt P(lambda) / (rho s)) / L0, with
    rho s v / dt = STALL E.
    """

    def rate(t: float, stretch: list[float]) -> list[float]:
        """d lambda / dt [1/s]."""
        return [2 * SPEED * (1 - uniaxial(LAW, NU, stretch[0])[0] / STALL) / gauge]

    stretch = float(solve_ivp(rate, (0, duration), [1.0], rtol=1e-8).y[0, -1])
    return stretch, (stretch - 1) * gauge / (2 * SPEED * duration)


def pulled(setting: Setting, grips: str, duration: float) -> tuple[float, float]:
    """Mean displacement of the held particles / (v t), and stretch of the middle, after `duration` [s]."""
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
    outwards = simulator.state.side * simulator.state.points.U.to_numpy()[:, 0].astype(float)
    displacement = float(outwards[held].mean())
    middle = np.abs(simulator.particles.X[:, 0] - 1) < 2 * h
    return displacement / (SPEED * duration), float(np.linalg.svd(last.F[middle], compute_uv=False)[:, 0].mean())


def run(setting: Setting) -> Iterator[Check]:
    """Rigid grips in a short pull; soft grips in a long pull, over most of which they slip."""
    gauge = GAUGE * 2 / CELLS
    ratio = pulled(setting, "rigid", 0.5 * gauge / (2 * SPEED))[0]
    yield absolute("rigid: displacement / (v t)", 1, ratio, 1e-4)
    duration = (0.8 if setting.quick else 2.36) * gauge / (2 * SPEED)
    stretch, exact_ratio = slipping(duration, gauge)
    ratio, middle = pulled(setting, "soft", duration)
    yield relative("soft: displacement / (v t)", exact_ratio, ratio, 0.15)
    yield relative("soft: stretch of the middle", stretch, middle, 0.15)
