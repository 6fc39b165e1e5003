"""The verification problems: cheap ones meet their tolerances, and the command says what was missed."""

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.special import itairy

from fracsim.scene.vocab import Solver
from fracsim.verify import plots, problem
from fracsim.verify.__main__ import main
from fracsim.verify.closed_form import nominal, softening, uniaxial
from fracsim.verify.elements import edge_deflection, mesh
from fracsim.verify.problem import Check, Setting
from fracsim.verify.problems import axis_aligned, vortex, wave

EXACT = [("translation", "both"), ("decay", "both"), ("collision", "updated"), ("damage_history", "both")]
"""To round-off in float64."""
CHEAP = [("axial_vibration", "both"), ("impact", "updated"), ("snap_back", "total"), ("grips", "both"),
         ("gaussians", "total"), ("vortex", "both")]  # fmt: skip
"""At their smallest size in float32, the default."""


def pairs(table: list[tuple[str, str]]) -> list[tuple[str, str]]:
    return [(name, form) for name, forms in table for form in problem.FORMULATIONS if forms in (form, "both")]


def missed(name: str, form: str, **preset: object) -> list[Check]:
    """Run a problem at its smallest size; what does not meet its tolerance."""
    rows = list(problem.run(name, Setting(dataclasses.replace(problem.preset("default"), **preset), form, quick=True)))
    assert rows
    return [row for row in rows if row.ok == "no"]


@pytest.mark.parametrize(("name", "form"), pairs(EXACT))
def test_exact_problems_hold_to_round_off(name: str, form: str) -> None:
    assert not missed(name, form, precision="float64")


@pytest.mark.parametrize(("name", "form"), pairs(CHEAP))
def test_cheap_problems_meet_their_tolerances(name: str, form: str) -> None:
    assert not missed(name, form)


def test_manufactured_solution_converges() -> None:
    """Between 8 and 16 cells a wavelength, where the order is still rising; between 16 and 32 is for the command."""
    setting = Setting(problem.preset("default"), "total")
    coarse, fine = (axis_aligned.error(setting, cells, 0.25) for cells in (8, 16))
    assert math.log2(coarse / fine) > 1.5


def test_the_front_is_as_late_as_bloch_waves_of_the_row_say() -> None:
    """Two particles a cell at 1/4 from a node, lumped masses, leapfrog: sin(w dt / 2) = sqrt(K / m) dt / 2."""
    k, f = 0.05, np.array([[0.25], [-0.25]])
    step = np.array([-1, 0, 1])
    weight = np.stack([(0.5 - f) ** 2 / 2, 0.75 - f**2, (0.5 + f) ** 2 / 2], axis=-1)[:, 0]
    stiffness = (np.abs((4 * weight * (step - f) * np.exp(1j * k * (step - f))).sum(axis=1)) ** 2).mean()
    omega = 2 / wave.COURANT * np.arcsin(wave.COURANT / 2 * np.sqrt(stiffness))
    assert (1 - omega / k) / k**2 == pytest.approx(wave.DISPERSION, rel=0.005)
    assert 1 / 3 + itairy(wave.HALF)[2] == pytest.approx(0.5, abs=1e-4)
    assert wave.late(50) == pytest.approx(0.0203, rel=0.01)


@pytest.mark.parametrize("t", [0.1, 0.4])
def test_body_force_of_the_standing_wave_balances_momentum(t: float) -> None:
    """rho u'' - Div P by central differences: step^2 u'''' / 12, 1e-6 of the largest term at a step of 1e-4."""
    X, step, E = np.random.default_rng(0).uniform(0.02, 0.48, (20, 3)), 1e-4, axis_aligned.E

    def stress(Y: np.ndarray) -> np.ndarray:
        return E * nominal("neo_hookean", axis_aligned.NU, axis_aligned.stretches(Y, t))

    divergence = np.stack(
        [(stress(X + step * e)[:, k] - stress(X - step * e)[:, k]) / (2 * step) for k, e in enumerate(np.eye(3))], 1
    )
    u = [axis_aligned.displacement(X, t + k * step) for k in (-1, 0, 1)]
    b = (u[0] - 2 * u[1] + u[2]) / step**2 - divergence / axis_aligned.DENSITY
    assert axis_aligned.body_force(X, t) == pytest.approx(b, abs=1e-5 * np.abs(b).max())


@pytest.mark.parametrize("law", vortex.LAWS)
def test_body_force_of_the_vortex_balances_momentum(law: str) -> None:
    """rho u'' - Div P with F and P from the displacement alone, by central differences."""
    rng, t, step = np.random.default_rng(1), 0.3, 1e-4
    R, angle = rng.uniform(0.8, 1.2, 20), rng.uniform(0, 2 * np.pi, 20)
    X = np.stack([R * np.cos(angle), R * np.sin(angle), 0 * R], axis=1)

    def piola(Y: np.ndarray) -> np.ndarray:
        F = np.tile(np.eye(3), (len(Y), 1, 1))
        for k in (0, 1):
            e = step * np.eye(3)[k]
            F[:, :, k] += (vortex.displacement(Y + e, t) - vortex.displacement(Y - e, t)) / (2 * step)
        U, l, Vt = np.linalg.svd(F)
        return U @ (vortex.E * nominal(law, vortex.NU, l)[:, :, None] * Vt)

    e = step * np.eye(3)
    divergence = sum((piola(X + e[k])[:, :, k] - piola(X - e[k])[:, :, k]) / (2 * step) for k in (0, 1))
    u = [vortex.displacement(X, t + k * step) for k in (-1, 0, 1)]
    assert np.abs(vortex.acceleration(X, t) - (u[0] - 2 * u[1] + u[2]) / step**2).max() < 1e-4
    b = vortex.acceleration(X, t) - divergence / vortex.DENSITY
    # Second differences of alpha, whose fourth derivative is 6144 A: step^2 * 6144 / 12 of the shear's slope.
    assert vortex.body_force(law, X, t) == pytest.approx(b, abs=1e-4)


def test_closed_form_of_the_softening_bar() -> None:
    """At the peak (1 - d) P has no slope, or the thresholds begin."""
    stretch, peak, work = softening("fixed_corotated", 0.3, 1.5, 2.3)
    assert (stretch, peak, work) == pytest.approx((1.6219, 0.45866, 0.37612), rel=1e-4)
    assert softening("neo_hookean", 0.45, 2.6, 3.0)[0] == 2.6
    assert uniaxial("neo_hookean", 0.45, 1 + 1e-6)[0] == pytest.approx(1e-6, rel=1e-4)


def test_elements_bend_a_slender_block_as_a_beam() -> None:
    """An end load without lateral coupling: P L^3 / (3 E I) + 1.2 P L / (G A), 1.2 for a rectangle."""
    L, depth = 2.0, 0.1
    corners = np.array([[0, 0], [L, 0], [L, depth], [0, depth]])
    exact = depth * L**3 / (3 * depth**3 / 12) + 1.2 * L * 2
    assert edge_deflection(corners, 0.0, 16) == pytest.approx(exact, rel=5e-4)
    nodes, elements = mesh(corners, 2)
    assert nodes[elements[-1][-1]] == pytest.approx(corners[2])


def test_a_fixed_substep_keeps_its_courant_number() -> None:
    setting = Setting(problem.preset("paper"), "updated")
    assert setting.solver(50).dt == pytest.approx(3e-4)
    assert problem.preset("reference").precision == "float64"
    assert setting.solver(50).formulation == "updated"
    assert isinstance(Setting(Solver(), "total").solver(50).dt, str)


def test_a_run_that_fails_is_a_missed_check(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(setting: Setting):  # type: ignore[no-untyped-def]
        yield problem.reported("a", 1.0)
        raise RuntimeError("particle 3 flew off")

    monkeypatch.setattr("fracsim.verify.problems.decay.run", run)
    first, last = problem.run("decay", Setting(Solver(), "total"))
    assert (first.ok, last.ok) == ("", "no")
    assert "particle 3" in last.quantity


def test_slopes_and_verdicts() -> None:
    line = [Check("e, n", 0, 0, 3 * h**2, axis="h", at=h) for h in (0.1, 0.05, 0.025)]
    assert plots.slope(line) == pytest.approx(2)
    assert problem.relative("q", 2.0, 2.1, 0.06).ok == "yes"
    assert problem.at_least("q", 1.8, math.nan).ok == "no"
    assert problem.reported("q", 1.0).ok == ""


def test_the_command_prints_and_stores(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A missed tolerance, here that of `total` in float32, is in the table and is no error."""
    argv = ["--quick", "--only", "translation", "axial_vibration", "--out", str(tmp_path)]
    assert main(argv) == 0
    assert "tolerances met" in capsys.readouterr().out
    with (tmp_path / "default_quick_part.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["problem"] for row in rows} == {"translation", "axial_vibration"}
    assert all(row["commit"] and row["cpu"] and row["quality"] == "default" for row in rows)
    assert 0 < (tmp_path / "axial_vibration.png").stat().st_size < 100_000


@pytest.mark.parametrize("argv", [["--only", "nothing"], ["--quality", "best"], ["--formulation", "mixed"]])
def test_bad_arguments_exit_with_2(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(argv)
    assert stopped.value.code == 2
    assert "invalid choice" in capsys.readouterr().err
