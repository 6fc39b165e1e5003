"""The plan of a sweep: the same scenes as the sweep runs, counted, priced and predicted without running them."""

import json
from collections import Counter

import pytest

from fracsim import Scene, compose
from fracsim.dataset import calibrate
from fracsim.dataset.__main__ import main
from fracsim.dataset.breaks import breaking_frame, breaking_stretch
from fracsim.dataset.plan import figures, plan
from fracsim.scene import expand
from fracsim.scene.vocab import Capture, Loading
from tests.command import SMALL

pytestmark = pytest.mark.usefixtures("taichi")
COST = calibrate.Cost(clip=1.0, substep=0.0, particle=1e-7, pixel=2e-7, splat=0.0, growth={"fixed_corotated": 1.0},
                      video=0.5, other=1e6, error=0.1)  # fmt: skip


@pytest.fixture(scope="module")
def table2(taichi):
    return plan(expand.scenes(["+sweep=table2"]))


def test_table2_has_the_clips_of_the_paper(table2):
    assert len(table2.clips) == 7020
    assert table2.splits() == {"train": 4212, "test": 2808}
    assert {(row["clips"], row["class"]) for row in table2.counts()} == {(702, "low_stretch"), (702, "high_stretch")}
    assert not table2.duplicates


def test_table2_covers_each_axis_evenly(table2):
    """702 clips of an object over 3 E, 3 nu, 2 thresholds: equal; over 12 axes, 4 offsets, 4 speeds: within one."""
    covered = table2.coverage()
    assert set(covered) == {"material.E", "material.nu", "fracture.onset", "fracture.crit", "loading.axis_deg",
                            "loading.offset", "loading.speed"}  # fmt: skip
    for values in covered.values():
        for name in ("cake", "whale"):
            clips = [row[name] for row in values.values() if name in row]
            assert sum(clips) == 702
            assert max(clips) - min(clips) <= 1
    assert set(table2.by_object()) == {"material.law", "material.viscosity", "material.decay"}


@pytest.mark.parametrize("words", [
    ("asset=bread,duck", "draw=range(0,3)"),
    ("-m", "material.E=2e3,6e3", "loading.speed=1,2"),
    ("asset=duck", "draw=[5,700]", "material.E=3e4"),
    ("draw=-1,3", "quality=preview"),
    ("+sweep=smoke", "asset=ring"),
    ("asset=bread,duck", "capture.maps=[damage],[]", "solver.dt=auto,1e-4"),
])  # fmt: skip
def test_scenes_are_those_that_hydra_composes(words):
    jobs = expand.jobs(words)
    assert expand.scenes(words) == [compose(*job.overrides) for job in jobs]
    assert len(jobs) > 1


@pytest.mark.parametrize(("words", "message"), [
    (["draw=701,702"], r"draw=702 is not in the parameter table"),
    (["material.E=6e3,1"], r"material\.E=1 is not allowed"),
    (["material.E=6e3,soft"], r"material\.E=soft is not allowed"),
    (["fracture.onset=1.5,4"], r"fracture\.crit=2\.3 must be greater than fracture\.onset=4"),
    (["+sweep=tabel2"], r"sweep=tabel2 is not known: choose one of .*table2"),
    (["foo=1,2"], r"foo=1 is not a field of a scene"),
])  # fmt: skip
def test_a_bad_word_is_one_clear_error(words, message):
    with pytest.raises(ValueError, match=message):
        expand.scenes(words)


def test_duplicates_are_named_and_counted_once():
    made = plan(expand.scenes(["draw=0,3,3", "asset=bread"]))
    assert len(made.clips) == 2
    assert made.duplicates == {made.clips[1].id: 2}


def test_the_predicted_frame_is_that_of_the_closed_form():
    """2 v t = (stretch - 1) gauge; 0.25 m at 2 x 0.5 m/s and a stretch of 1.5 take 0.125 s, shown first by frame 13."""
    scene = Scene(loading=Loading(offset=0.15, speed=0.5))
    assert breaking_frame(scene, 1.5) == 13
    assert breaking_frame(scene, 1.48) == 12
    assert scene.fracture.onset < breaking_stretch(scene) < scene.fracture.crit


def test_breaks_are_counted_by_when_they_come():
    """The bar breaks at one stretch; slow pulls reach it after frame 80, or after the last."""
    scenes = [Scene(loading=Loading(speed=v), capture=Capture(frames=100)) for v in (0.5, 0.09, 0.01)]
    made = plan(scenes)
    assert made.breaks() == {kind: {"training": 1, "later": 1, "never": 1} for kind in ("low_stretch", "all")}
    assert sum(sum(n.values()) for n in made.frames().values()) == 2
    assert {start for start in made.frames()} == set(range(0, max(made.frames()) + 10, 10))


def test_the_cost_is_the_sum_over_the_clips():
    scenes = expand.scenes(["draw=0,1"])
    total = plan(scenes).cost(COST)
    each = [COST.of(scene) for scene in scenes]
    assert total["hours"] == pytest.approx(sum(s for s, _ in each) / 3600)
    assert total["gb"] == pytest.approx(sum(b for _, b in each) / 1e9)
    work = calibrate.work(scenes[0], COST.substeps(scenes[0]))
    expected = 1.0 + 1e-7 * work.substeps * work.particles + 2e-7 * 100 * 512 * 512
    assert each[0][0] == pytest.approx(expected)


def test_particles_are_known_without_filling_the_object():
    """Volume over spacing cubed, from a filling with 40 particles along the object: good to a few per cent."""
    from fracsim.asset.build import build

    for name in ("bread", "ring"):
        scene = compose(f"asset={name}", "solver.cells=80")
        assert calibrate.particles(scene) == pytest.approx(len(build(scene.asset, scene.solver.spacing, 0).X), rel=0.1)


def test_the_command_prints_and_stores_the_plan(tmp_path, monkeypatch, capsys):
    """The calibration stores its figures, so that a second plan needs none; both print the same counts."""
    monkeypatch.setenv("FRACSIM_CACHE", str(tmp_path))
    file = tmp_path / "plan.json"
    words = ("asset=bread", "draw=range(0,4)", *SMALL)
    assert main(["plan", *words, "--json", str(file)]) == 0
    first = capsys.readouterr().out
    assert "calibrating" not in first
    made = json.loads(file.read_text())
    assert made["splits"] == {"test": 4}
    assert made["cost"]["hours"] > 0 < made["cost"]["gb"]
    assert Counter(run["name"] for run in made["calibration"]["about"]["runs"]) == {"small": 1, "middle": 1, "check": 1}
    assert main(["plan", "-m", *words, "--no-calibrate"]) == 0
    assert capsys.readouterr().out == first
    assert made["cost"] == figures(plan(expand.scenes(words)), calibrate.stored())["cost"]


def test_without_a_calibration_the_way_out_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("FRACSIM_CACHE", str(tmp_path))
    assert main(["plan", "draw=0,1", "--no-calibrate"]) == 2
    assert "plan once without --no-calibrate" in capsys.readouterr().err
