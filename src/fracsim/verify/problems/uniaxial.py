"""A bar with free sides, stretched slowly: nominal stress, von Mises stress and volume against the root of P22 = 0."""

from collections.abc import Iterator

import numpy as np

from fracsim.simulate import Simulator
from fracsim.verify.closed_form import thinned, uniaxial
from fracsim.verify.problem import Check, Setting, relative, told
from fracsim.verify.stage import NEVER, bar, free, put, scene
from fracsim.vocab import Backend, Capture, Loading, Material, Scene

STRETCHES = (1.5, 2.0, 2.6, 3.0, 3.3)
TABLE = {
    ("fixed_corotated", 0.2): (0.46604, 0.89558, 1.39547, 1.72573, 1.97294),
    ("fixed_corotated", 0.25): (0.45443, 0.86550, 1.34327, 1.65926, 1.89598),
    ("fixed_corotated", 0.3): (0.44287, 0.83668, 1.29423, 1.59723, 1.82437),
    ("neo_hookean", 0.45): (0.35861, 0.59880, 0.84209, 0.99334, 1.10381),
    ("neo_hookean", 0.49): (0.35321, 0.58640, 0.82222, 0.96892, 1.07613),
    ("neo_hookean_decoupled", 0.45): (0.34349, 0.55303, 0.74439, 0.85275, 0.92714),
}
"""Nominal stress / E at STRETCHES, solved once more and elsewhere, to five digits."""
RUNS = (("fixed_corotated", 0.3, 2.0), ("neo_hookean", 0.45, 2.6))
E = 2e3
PLACES = tuple((k + 0.5) / 8 for k in range(8))
"""Of the faces of the grips between nodes [cells]: grips hold whole nodes, so one place may be off by half a cell."""


def law_at(setting: Setting, law: str, nu: float) -> float:
    """Largest relative error of the law's von Mises stress at the closed-form F of all STRETCHES."""
    solver, worst = setting.solver(20), 0.0
    body = bar(solver)
    state = free(scene(solver, Material(law=law, E=E, nu=nu), body.X), body)
    for stretch in STRETCHES:
        side = thinned(law, nu, stretch)
        put(state, F=np.diag([stretch, side, side]))
        tau = state.observe()[0].astype(float).mean(axis=0)
        _, cauchy, J = uniaxial(law, nu, stretch)
        worst = max(worst, abs((tau[0, 0] - tau[1, 1]) / J / E / cauchy - 1))
    return worst


def pulled(setting: Setting, law: str, nu: float, most: float, gauge: float) -> tuple[float, float, float]:
    """Mean load over section and E, and that of the closed form, in the last tenth of a pull to a nominal stretch
    `most` of a bar of 4 x 4 cells between sliding grips `gauge` cells apart; J of its middle at the end."""
    solver, material = setting.solver(50), Material(law=law, E=E, nu=nu)
    h, frames = solver.h, 60
    speed = (0.02 if setting.quick else 0.01) * np.sqrt(material.E / material.density)
    duration = (most - 1) * gauge * h / (2 * speed)
    s = Scene(material=material, fracture=NEVER, solver=solver, backend=Backend(threads=1),
              loading=Loading(offset=(gauge / 2 + 1) * h, thickness=2 * h, speed=speed, grips="sliding"),
              capture=Capture(frames=frames, fps=(frames - 1) / duration))  # fmt: skip
    simulator = Simulator(s, bar(solver, (22 * h, 4 * h, 4 * h)))
    *_, frame = simulator.frames()
    stretch = np.array(simulator.report.history.nominal_stretch)
    # The load of a frame is its mean since the frame before.
    exact = np.mean([uniaxial(law, nu, float(s))[0] for s in (stretch[-7:-1] + stretch[-6:]) / 2])
    load = np.mean(simulator.report.history.load[-6:]) / (4 * h) ** 2 / E
    middle = np.abs(simulator.particles.X[:, 0] - 1) < 2 * h
    return float(load), float(exact), float(np.linalg.det(frame.F[middle]).mean())


def run(setting: Setting) -> Iterator[Check]:
    """The law at prescribed F for the whole table; then pulls, whose load is that of the table."""
    for (law, nu), nominal in TABLE.items():
        solved = max(abs(uniaxial(law, nu, s)[0] - P) for s, P in zip(STRETCHES, nominal, strict=True))
        assert solved < 1e-5, "the closed form disagrees with the table"
        yield relative(f"{law} {nu}, von Mises, 1 + worst of 5", 1, 1 + law_at(setting, law, nu),
                       setting.by_precision(1e-4, 1e-5))  # fmt: skip
    for law, nu, most in RUNS:
        runs = np.array([pulled(setting, law, nu, most, 16 + 2 * place) for place in PLACES])
        load, exact, J = runs.mean(axis=0)
        what = f"{law} {nu}, pulled to {most:g}, mean of {len(PLACES)} places of the grips: "
        yield relative(what + "P / E", float(exact), float(load), 0.01)
        yield relative(what + "J", uniaxial(law, nu, most)[2], float(J), 0.01)
        yield told(f"{law} {nu}, half the range of P / E over its mean", float(np.ptp(runs[:, 0]) / 2 / load))
