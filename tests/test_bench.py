"""The benchmark compares like with like, and stores what it measured."""

import csv

import numpy as np
import pytest

from fracsim import Scene, Solver
from fracsim.bench import bar, splatting, startup
from fracsim.bench.__main__ import PARTS, main
from fracsim.bench.blocked import Blocked
from fracsim.bench.plain import Plain
from fracsim.bench.record import Row, median, table, write
from fracsim.bench.worker import Worker
from fracsim.vocab import CENTRE
from tests.sim import bars

CELLS, SUBSTEPS = 50, 60
COLUMNS = {"benchmark", "variant", "value", "unit", "target", "met", "cpu", "cores", "python", "taichi", "numpy",
           "commit", "date"}  # fmt: skip


def paths(formulation):
    """Displacements of the free bar by the plain substep, by the one in blocks, and by this project's solver [m]."""
    solver = Solver(cells=CELLS, formulation=formulation, damping="per_substep")
    X = bar.lattice(solver.h)
    v = bar.velocity(X)
    out = []
    for body in (Plain(X, v, CELLS), Blocked(X, v, CELLS)):
        body.run(SUBSTEPS)
        out.append(body.positions() - X)
    state = bars.free(Scene(material=bar.material("fixed_corotated"), solver=solver), bars.particles(X, solver.spacing))
    state.V.from_numpy(v)
    state.run(SUBSTEPS, bar.DT, 0.0)
    return [*out, state.U.to_numpy()]


def test_full_size_is_the_bar_of_the_comparison():
    X = bar.lattice(2 / 150)
    assert len(X) == 81_000
    np.testing.assert_allclose(X.max(axis=0) - X.min(axis=0) + 1 / 150, (0.6, 0.2, 0.2), atol=1e-6)
    np.testing.assert_allclose(X.mean(axis=0, dtype=float), CENTRE, atol=1e-6)


def test_competitors_move_the_bar_alike():
    """One discretisation, so only round-off differs: positions around 1 m in float32 lose half of 1.2e-7 a substep."""
    plain, blocked, ours = paths("updated")
    moved = np.abs(plain).max()
    assert moved > 1e-3  # and elastically: the bar does not fly on with its first velocities
    X = bar.lattice(2 / CELLS)
    assert np.abs(plain - SUBSTEPS * bar.DT * bar.velocity(X)).max() > 0.1 * moved
    tolerance = SUBSTEPS * 1.2e-7
    np.testing.assert_allclose(blocked, plain, atol=tolerance)
    np.testing.assert_allclose(ours, plain, atol=tolerance)


def test_the_total_formulation_differs_by_the_size_of_the_strain():
    """Weights of the rest state, not the present one: a relative difference of the order of the strain, 0.8 /s x 6 ms."""
    plain, _, ours = paths("total")
    assert np.abs(ours - plain).max() < 0.005 * np.abs(plain).max()


def test_ratio_targets_and_medians():
    row = median("b", "v", [3.0, 1.0, 2.0], "s", most=2.0)
    assert (row.value, row.best, row.target, row.met) == (2.0, 1.0, "<= 2", "yes")
    row = median("b", "v", [7.0, 9.0, 7.5], "times", least=8)
    assert (row.best, row.target, row.met) == (9.0, ">= 8", "no")
    assert Row("b", "v", 1.0, "s").met == "" == row.without_target().target


def test_csv_names_hardware_and_commit(tmp_path):
    rows = [Row("b", "v, w", 1.25, "s", most=1), Row("b", "x", 2, "s")]
    with write(rows, tmp_path, "full").open(newline="") as file:
        first, second = csv.DictReader(file)
    assert set(first) >= COLUMNS
    assert (first["variant"], first["value"], first["target"], first["met"]) == ("v, w", "1.25", "<= 1", "no")
    assert all(first[name] for name in COLUMNS)
    assert (second["target"], second["met"]) == ("", "")
    assert table(rows).row_count == 2


def test_a_worker_that_dies_is_an_error():
    with pytest.raises(RuntimeError, match=r"fracsim\.bench\.substep nobody ended with status 2"):
        Worker("substep", "nobody")


def test_the_solid_has_as_many_gaussians_as_asked_for():
    particles, frame = splatting.solid(1000)
    assert len(particles) == len(frame.x) == 1000
    assert np.isfinite(frame.F).all()
    assert (frame.J > 0).all()


def test_importing_needs_neither_taichi_nor_torch():
    seconds, heavy = startup.imports(1)
    assert heavy.met == "yes"
    assert seconds.value > 0


def stored(folder):
    (file,) = folder.glob("*_quick.csv")
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_it_runs_and_stores(tmp_path):
    assert main(["--quick", "--only", "splatting", "--out", str(tmp_path)]) == 0
    rows = stored(tmp_path)
    assert len(rows) == 4
    assert all(float(row["value"]) > 0 and row["target"] == "" for row in rows)


@pytest.mark.slow
def test_all_parts_run(tmp_path):
    assert main(["--quick", "--out", str(tmp_path)]) == 0
    rows = stored(tmp_path)
    told = " ".join(row["benchmark"] for row in rows)
    assert all(word in told for word in ("substep", "picture", "import", "cold", "warm", "kernels", "memory"))
    assert len(PARTS) == 4
