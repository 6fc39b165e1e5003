"""The closed form of a uniform bar, and thresholds that belong to a cell size."""

import numpy as np
import pytest

from fracsim import Fracture, Material, Scene, Solver
from fracsim.solve.setup import medium
from fracsim.solve.uniaxial import UniaxialBar, rescaled_crit, uniaxial_bar

# law, E, nu, onset, crit, stretch and nominal stress over E where (1 - d) P peaks
SOFTENING = [
    ("fixed_corotated", 2e3, 0.3, 1.5, 2.3, 1.6219, 0.45866),
    ("fixed_corotated", 2e3, 0.3, 2.0, 3.0, 2.0, 0.83668),
    ("neo_hookean", 2e4, 0.45, 2.6, 3.0, 2.6, 0.84209),
    ("neo_hookean", 2e4, 0.49, 3.0, 3.3, 3.0, 0.96892),
]


def scene(law: str, E: float, nu: float, onset: float, crit: float, **extra: float) -> Scene:
    return Scene(material=Material(law=law, E=E, nu=nu), fracture=Fracture(onset=onset, crit=crit, **extra),
                 solver=Solver(cells=100))  # fmt: skip


def bar(scene: Scene, crit: float | None = None) -> UniaxialBar:
    return uniaxial_bar(medium(scene), crit)


def crit_of(scene: Scene) -> float:
    return rescaled_crit(medium(scene), scene.fracture.length)


@pytest.mark.parametrize(("law", "E", "nu", "onset", "crit", "stretch", "peak"), SOFTENING)
def test_break_stretch_and_peak_of_the_softening_bar(
    law: str, E: float, nu: float, onset: float, crit: float, stretch: float, peak: float
) -> None:
    b = bar(scene(law, E, nu, onset, crit))
    assert b.breaks_at == pytest.approx(stretch, abs=(crit - 1) / 1000)
    assert b.stress.max() / E == pytest.approx(peak, rel=1e-3)


def test_work_to_break_is_the_area_under_the_curve() -> None:
    """g / E of the table of softening bars, from an integration by hand."""
    assert bar(scene("fixed_corotated", 2e3, 0.3, 1.5, 2.3)).work / 2e3 == pytest.approx(0.37612, rel=1e-4)
    assert bar(scene("neo_hookean", 2e4, 0.45, 2.6, 3.0)).work / 2e4 == pytest.approx(0.95255, rel=1e-4)


def test_thresholds_keep_the_work_to_part_a_section() -> None:
    """The work to part a section is the same whatever h is; at h = length nothing changes."""
    given = scene("fixed_corotated", 2e3, 0.3, 1.5, 2.3, length=0.02)
    assert crit_of(given) == pytest.approx(2.3, abs=1e-5)
    work = []
    for cells in (75, 100, 200):
        given.solver = Solver(cells=cells)
        work.append(bar(given, crit_of(given)).work_to_part(given.solver.h, 0.02))
    assert np.ptp(work) < 1e-4 * work[0]


def test_cells_too_large_or_too_small_for_the_length_are_refused() -> None:
    coarse = scene("fixed_corotated", 2e3, 0.3, 1.5, 2.3, length=0.005)
    with pytest.raises(ValueError, match=r"fracture\.length=0\.005 m cannot be kept by cells of 0\.02 m"):
        crit_of(coarse)
    fine = scene("neo_hookean", 2e4, 0.3, 2.6, 3.0, length=0.9)
    fine.solver = Solver(cells=2000)
    with pytest.raises(ValueError, match=r"asks for a lambda_crit above 10"):
        crit_of(fine)
