"""A slowly stretched bar with free sides: nominal stress, von Mises stress and volume against the root of P22 = 0."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fracsim.lab.stage import NEVER, bar, free, medium, put, turned
from fracsim.scene.vocab import CENTRE, Backend, Capture, Loading, Material, Scene
from fracsim.solve.simulator import Simulator
from fracsim.verify.closed_form import lateral_stretch, uniaxial
from fracsim.verify.problem import Check, Setting, relative
from fracsim.verify.pull import PLACES

STRETCHES = (1.5, 2.0, 2.6, 3.0, 3.3)
TABLE = {
    ("fixed_corotated", 0.2): (0.46604, 0.89558, 1.39547, 1.72573, 1.97294),
    ("fixed_corotated", 0.25): (0.45443, 0.86550, 1.34327, 1.65926, 1.89598),
    ("fixed_corotated", 0.3): (0.44287, 0.83668, 1.29423, 1.59723, 1.82437),
    ("neo_hookean", 0.45): (0.35861, 0.59880, 0.84209, 0.99334, 1.10381),
    ("neo_hookean", 0.49): (0.35321, 0.58640, 0.82222, 0.96892, 1.07613),
    ("neo_hookean_decoupled", 0.45): (0.34349, 0.55303, 0.74439, 0.85275, 0.92714),
}
"""Nominal stress / E at STRETCHES, computed independently, to five digits."""
RUNS = (("fixed_corotated", 0.3, 2.0), ("neo_hookean", 0.45, 2.6))
E = 2e3
AXES = (10.0, 20.0, 30.0, 45.0)
"""Pull axes of bars oblique to the grid [degrees]."""


def law_at(setting: Setting, law: str, nu: float) -> float:
    """Largest relative error of the solver's von Mises stress at the closed-form F of all STRETCHES."""
    solver, worst = setting.solver(20), 0.0
    body = bar(solver)
    state = free(medium(solver, Material(law=law, E=E, nu=nu)), body)
    for stretch in STRETCHES:
        side = lateral_stretch(law, nu, stretch)
        put(state, F=np.diag([stretch, side, side]))
        tau = state.observe()[0].astype(float).mean(axis=0)
        _, cauchy, J = uniaxial(law, nu, stretch)
        worst = max(worst, abs((tau[0, 0] - tau[1, 1]) / J / E / cauchy - 1))
    return worst


def pulled(setting: Setting, law: str, nu: float, most: float, gauge: float, axis: float = 0) -> tuple[float, float]:
    """Load and J of a pulled bar, each over the closed form.

    The bar has 4 x 4 cells in section and sliding grips, `gauge` cells apart. It is pulled to the nominal stretch
    `most` along `axis` [degrees], on a lattice along x. The load is a mean over the last tenth of the pull, J is that
    of the middle at the end.
    """
    solver, material = replace(setting.solver(50), lattice="world"), Material(law=law, E=E, nu=nu)
    h, frames = solver.h, 60
    speed = (0.02 if setting.quick else 0.01) * np.sqrt(material.E / material.density)
    duration = (most - 1) * gauge * h / (2 * speed)
    s = Scene(material=material, fracture=NEVER, solver=solver, backend=Backend(threads=1),
              loading=Loading(offset=(gauge / 2 + 1) * h, thickness=2 * h, speed=speed, grips="sliding", axis_deg=axis),
              capture=Capture(frames=frames, fps=(frames - 1) / duration))  # fmt: skip
    simulator = Simulator(s, turned(bar(solver, (22 * h, 4 * h, 4 * h)), axis))
    *_, frame = simulator.frames()
    stretch = np.array(simulator.report.history.nominal_stretch)
    # The load of a frame is its mean since the previous frame.
    exact = np.mean([uniaxial(law, nu, float(s))[0] for s in (stretch[-7:-1] + stretch[-6:]) / 2])
    load = np.mean(simulator.report.history.load[-6:]) / (4 * h) ** 2 / E
    middle = np.abs((simulator.particles.X - np.asarray(CENTRE)) @ s.loading.axis) < 2 * h
    return float(load / exact), float(np.linalg.det(frame.F[middle]).mean() / uniaxial(law, nu, most)[2])


def run(setting: Setting) -> Iterator[Check]:
    """The law at a prescribed F for the whole table; then load and J of pulled bars."""
    for (law, nu), nominal in TABLE.items():
        solved = max(abs(uniaxial(law, nu, s)[0] - P) for s, P in zip(STRETCHES, nominal, strict=True))
        assert solved < 1e-5, "the closed form disagrees with the table"
        yield relative(f"{law} {nu}, von Mises, 1 + worst of 5", 1, 1 + law_at(setting, law, nu),
                       setting.by_precision(1e-4, 1e-5))  # fmt: skip
    for law, nu, most in RUNS:
        for what, tolerance, runs in (
            (f"worst of {len(PLACES)} places of the grips", 0.01, [(16 + 2 * place, 0.0) for place in PLACES]),
            (f"worst of {len(AXES)} axes", 0.02, [(16.0, axis) for axis in AXES]),  # 0.15 cells at each end
        ):
            loads, Js = np.array([pulled(setting, law, nu, most, *r) for r in runs]).T
            for name, ratios in (("P", loads), ("J", Js)):
                worst = ratios[np.abs(ratios - 1).argmax()]
                yield relative(f"{law} {nu}, pulled to {most:g}: {name} / exact, {what}", 1, float(worst), tolerance)
