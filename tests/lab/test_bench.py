"""The benchmark compares like with like, and stores what it measured."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fracsim import Scene, Solver, backend
from fracsim.bench import bar, gpu, hidden, splatting, startup, substep
from fracsim.bench.__main__ import main
from fracsim.bench.blocked import Blocked
from fracsim.bench.plain import Plain
from fracsim.bench.plan import FULL
from fracsim.bench.record import Row, median, table, write
from fracsim.bench.scenes import broken_at
from fracsim.bench.worker import Worker
from fracsim.render.film import Film
from fracsim.scene.vocab import CENTRE, Camera
from tests.sim import bars

pytestmark = pytest.mark.usefixtures("taichi")
CELLS, SUBSTEPS = 50, 60
COLUMNS = {"benchmark", "variant", "value", "unit", "target", "met", "cpu", "cores", "python", "taichi", "numpy",
           "commit", "date"}  # fmt: skip


@pytest.fixture(scope="module")
def competitors():
    """Displacements of the bar by the plain substep, and by the one in blocks [m]."""
    X = bar.lattice(2 / CELLS)
    out = []
    for body in (Plain(X, bar.velocity(X), CELLS), Blocked(X, bar.velocity(X), CELLS)):
        body.run(SUBSTEPS)
        out.append(body.positions() - X)
    return out


def ours(formulation):
    """Displacements of the bar by this project's solver, held by no grip [m]."""
    solver = Solver(cells=CELLS, formulation=formulation, damping="per_substep", projection="every")
    X = bar.lattice(solver.h)
    state = bars.free(Scene(material=bar.material("fixed_corotated"), solver=solver), bars.particles(X, solver.spacing))
    state.points.V.from_numpy(bar.velocity(X))
    state.run(SUBSTEPS, bar.DT, 0.0)
    return state.points.U.to_numpy()


def test_full_size_is_the_bar_of_the_comparison():
    X = bar.lattice(2 / 150)
    assert len(X) == 81_000
    np.testing.assert_allclose(X.max(axis=0) - X.min(axis=0) + 1 / 150, (0.6, 0.2, 0.2), atol=1e-6)
    np.testing.assert_allclose(X.mean(axis=0, dtype=float), CENTRE, atol=1e-6)


def test_competitors_move_the_bar_alike(competitors):
    """One discretisation, so only round-off differs: positions around 1 m in float32 lose half of 1.2e-7 a substep."""
    plain, blocked = competitors
    largest = np.abs(plain).max()
    assert largest > 1e-3  # and elastically: the bar does not fly on with its first velocities
    X = bar.lattice(2 / CELLS)
    assert np.abs(plain - SUBSTEPS * bar.DT * bar.velocity(X)).max() > 0.1 * largest
    np.testing.assert_allclose(blocked, plain, atol=SUBSTEPS * 1.2e-7)
    np.testing.assert_allclose(ours("updated"), plain, atol=SUBSTEPS * 1.2e-7)


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


@pytest.mark.parametrize(("opacity", "least", "most"), [(0.98, 0.1, 0.6), (0.03, 1, 1)])
def test_gaussians_that_do_not_show_leave_the_picture_as_it_is(opacity, least, most):
    """Bit for bit; most of an opaque solid does not show, all of a translucent one does."""
    particles, frame = splatting.solid(20_000)
    particles = replace(particles, opacity=np.full(20_000, opacity, np.float32))
    film = Film(Scene(camera=Camera(width=128, height=128, half_width=0.33)))
    whole = film.shoot(frame, particles)
    mask = hidden.visible(film, 20_000)
    assert least <= mask.mean() <= most
    few = film.shoot(hidden.select(frame, mask), hidden.select(particles, mask))
    assert hidden.equal(whole, few)
    mask[np.flatnonzero(mask)[:100]] = False
    assert not hidden.equal(whole, film.shoot(hidden.select(frame, mask), hidden.select(particles, mask)))


def test_importing_needs_neither_taichi_nor_torch():
    seconds, heavy = startup.imports(1)
    assert heavy.met == "yes"
    assert seconds.value > 0


def test_the_run_that_is_timed_is_the_demo():
    makefile = (Path(__file__).parents[2] / "Makefile").read_text()
    (overrides,) = re.findall(r"^demo:.*\n\t\$\(RUN\) fracsim(.*)$", makefile, re.MULTILINE)
    assert tuple(overrides.split()) == FULL.run


def stored(folder):
    (file,) = folder.glob("*_quick.csv")
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_it_runs_and_stores(tmp_path):
    assert main(["--quick", "splatting", "--out", str(tmp_path)]) == 0
    rows = stored(tmp_path)
    assert len(rows) == 8
    (share,) = [float(row["value"]) for row in rows if row["variant"].startswith("share of a processor")]
    assert share <= 1.01  # of one thread, up to the resolution of the clocks
    assert all(float(row["value"]) > 0 and row["target"] == "" for row in rows)


def test_a_substep_is_timed_in_a_process_of_its_own():
    with Worker("substep", "ours", 1, "--cells=30", "--substeps=2") as worker:
        assert worker.ready["particles"] == 9 * 3 * 3 * 8
        assert worker.measure()["ns"] > 0


def test_a_machine_without_a_gpu_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(backend, "available", lambda arch: False)
    assert main(["gpu", f"--out={tmp_path}"]) == 2
    assert "none of cuda, vulkan, metal is available on this machine" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_gpu_is_timed_beside_the_cpu():
    """Here a second CPU stands for it."""
    found = {row.variant: row for row in gpu.rows(("cpu",), (30,), 2, 1)}
    assert list(found) == ["fixed_corotated, cpu", "fixed_corotated, cpu / cpu", "neo_hookean, cpu",
                           "neo_hookean, cpu / cpu"]  # fmt: skip
    assert found["fixed_corotated, cpu / cpu"].value == 1


def test_ratios_are_taken_within_a_round():
    """A machine that halves its speed in the second round changes no ratio."""
    ns = {"plain": [900.0, 1800.0], "blocked": [110.0, 220.0], "fixed_corotated": [120.0, 240.0],
          "fixed_corotated, pressure=particle": [100.0, 200.0]}  # fmt: skip
    for law in ("fixed_corotated", "neo_hookean"):
        ns |= {f"{law}, 1 thread": [40.0, 80.0], f"{law}, 1 thread, particles one by one": [160.0, 320.0]}
    *_, gain, _, lanes, _, share = substep.summary(ns, 81_000)
    assert (gain.value, gain.met, share.met) == (9.0, "yes", "yes")
    assert (lanes.value, lanes.met) == (4.0, "yes")
    assert share.value == pytest.approx(1 / 1.1)


def test_the_break_is_found_behind_the_blow_of_the_grips():
    """A blow of 9 N in the first tenth, then a pull up to 4 N: half of it lies between frames 18 and 19."""
    load = np.array([0, 9, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3.5, 3.5, 4, 3, 1, 0, 0])
    at, peak = broken_at(np.arange(22) / 10, load)
    assert (at, peak) == (pytest.approx(1.85), 4)
    assert np.isnan(broken_at(np.arange(22) / 10, np.arange(22.0))[0])


def test_an_unknown_name_is_an_error_with_the_known_names(capsys):
    with pytest.raises(SystemExit):
        main(["paretto"])
    assert "NAME=paretto is not known: choose from substep," in capsys.readouterr().err
