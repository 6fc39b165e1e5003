"""docs/method.md says all that a substep does: NumPy that follows the page moves particles as the kernels do."""

from typing import Any

import numpy as np
import pytest

from fracsim import Backend, Fracture, Loading, Material, Scene, Solver, backend
from fracsim.lab.stage import bar
from fracsim.solve import setup

from .substep import Substep

START, DT, STEPS = 0.04, 2e-4, 4
CASES: dict[str, dict[str, Any]] = {
    "as by default": {},
    "neo-Hookean, pressure of a particle, sliding at 20 degrees": {
        "law": "neo_hookean", "pressure": "particle", "grips": "sliding", "axis_deg": 20.0},
    "decoupled": {"law": "neo_hookean_decoupled"},
    "updated": {"formulation": "updated"},
    "updated, neo-Hookean, sliding": {"formulation": "updated", "law": "neo_hookean", "grips": "sliding"},
}  # fmt: skip
ROUND_OFF = {"fixed_corotated": 1e-6, "neo_hookean": 1e-11, "neo_hookean_decoupled": 1e-11}
"""Relative; the rotation of the fixed corotated law is iterated to 1e-6 of the stress at large strain."""


@pytest.fixture(scope="module", autouse=True)
def taichi() -> None:
    backend.start(Backend(arch="cpu", threads=2))


@pytest.mark.parametrize("case", CASES)
def test_the_page_moves_particles_as_the_kernels_do(case: str) -> None:
    """A gripped bar, strained and moving at random: some particles fail, some are damaged, some meet a shock."""
    chosen = {"law": "fixed_corotated", "grips": "rigid", "formulation": "total", **CASES[case]}
    loading = {k: v for k, v in chosen.items() if k in ("grips", "axis_deg")}
    solving = {k: v for k, v in chosen.items() if k in ("formulation", "pressure")}
    scene = Scene(
        backend=Backend(threads=1),
        material=Material(law=chosen["law"], E=6e3, nu=0.3, viscosity=800.0, decay=5.0),
        fracture=Fracture(onset=1.2, crit=1.4),
        loading=Loading(offset=0.2, speed=1.0, gravity=[0, -9.81, 0], **loading),
        solver=Solver(cells=40, precision="float64", **solving),
    )
    state = setup.state(scene, bar(scene.solver, (0.6, 0.2, 0.2)))
    rng = np.random.default_rng(0)
    state.points.F.from_numpy(np.eye(3) + 0.15 * rng.normal(size=(state.n, 3, 3)))
    state.points.V.from_numpy(rng.normal(size=(state.n, 3)))
    state.points.C.from_numpy(5 * rng.normal(size=(state.n, 3, 3)))
    numpy = Substep(state, START)
    for _ in range(STEPS):
        numpy.advance(DT)
    assert state.run(STEPS, DT, START) == STEPS
    on = (numpy.d < 1) | (not state.total)
    assert (numpy.d >= 1).any()
    assert ((numpy.d > 0) & (numpy.d < 1)).any()
    assert (np.linalg.det(numpy.F)[on] < 0.8).any()
    for name, array in (("u", state.points.U), ("F", state.points.F), ("d", state.points.D), ("v", state.points.V)):
        found, exact = getattr(numpy, name), array.to_numpy()
        assert np.abs(found - exact)[on].max() < ROUND_OFF[chosen["law"]] * np.abs(exact).max(), name
