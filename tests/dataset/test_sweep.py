"""Sweeps: the same samples whoever runs them, nothing lost, nothing made twice, failures kept and counted."""

import importlib.util
import os
import re
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hydra import compose as hydra_compose
from hydra import initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser

from fracsim import Scene, compose, sample
from fracsim.lab import kill_study
from fracsim.run import journal, lines, pipeline
from fracsim.run.attempt import Attempt, Summary, Task
from fracsim.run.outcome import Outcome
from fracsim.sample import folder as folders
from fracsim.scene.program import SIMULATE
from hydra_plugins.hydra_fracsim.draws import choices, chunks, split
from tests.command import SMALL, fracsim_command, samples, start

ONE_THREAD = (*SMALL, "backend.threads=1")
SWEEPS = sorted(p.stem for p in (SIMULATE.folder / "sweep").glob("*.yaml"))
WORKERS = {"joblib": ("hydra.launcher.n_jobs=2",), "submitit_local": (), "ray": ()}
PACKAGES = {"joblib": "joblib", "submitit_local": "submitit", "ray": "ray"}


def jobs(*overrides: str, chunk: int = 20) -> list[list[str]]:
    """The overrides of the jobs of a multirun."""
    return list(split(choices(OverridesParser.create().parse_overrides(list(overrides))), chunk))


def of_user(job: list[str]) -> list[str]:
    """Without what the sweeper adds for the display."""
    return [override for override in job if not override.startswith("hydra.")]


def params(name: str) -> list[str]:
    """The values that a sweep of conf/sweep varies."""
    SIMULATE.register()
    with initialize_config_dir(str(SIMULATE.folder), version_base="1.3"):
        cfg = hydra_compose("simulate", [f"+sweep={name}"], return_hydra_config=True)
    assert cfg.hydra.mode.name == "MULTIRUN"
    assert cfg.output.folder == f"outputs/{name}"
    return [f"{key}={value}" for key, value in cfg.hydra.sweeper.params.items()]


# Jobs.


def test_draws_go_into_jobs_of_at_least_twenty() -> None:
    """702 draws: 35 jobs of 20 or 21; every draw once, in order; one object a job."""
    made = jobs("asset=bread,duck", "draw=range(0,702)")
    assert len(made) == 70
    draws = [of_user(job)[1].removeprefix("draw=[").removesuffix("]").split(",") for job in made]
    assert {len(d) for d in draws} == {20, 21}
    assert [int(d) for part in draws for d in part] == [*range(702), *range(702)]
    assert {of_user(job)[0] for job in made[:35]} == {"asset=bread"}
    assert [f"hydra.sweeper.job.first={sum(map(len, draws[:i]))}" in job for i, job in enumerate(made)] == [True] * 70
    assert all("hydra.sweeper.job.total=1404" in job and "hydra.sweeper.job.varied=[asset,draw]" in job for job in made)


def test_few_draws_are_one_job_and_other_fields_a_job_each() -> None:
    assert [of_user(job) for job in jobs("draw=0,9", "asset=duck")] == [["asset=duck", "draw=[0,9]"]]
    assert [of_user(job) for job in jobs("draw=[0,9,4]", chunk=1)] == [["draw=0"], ["draw=9"], ["draw=4"]]
    assert [of_user(job) for job in jobs("material.E=2e3,6e3")] == [["material.E=2000.0"], ["material.E=6000.0"]]
    assert [len(part) for part in chunks([""] * 39, 20)] == [39]


def test_the_command_line_wins_over_the_file() -> None:
    made = jobs("asset=bread,duck", "draw=range(0,702)", "draw=range(0,40)", "asset=bread")
    assert [of_user(job)[0] for job in made] == ["asset=bread", "asset=bread"]
    assert of_user(made[0])[1] == f"draw=[{','.join(map(str, range(20)))}]"


@pytest.mark.parametrize("name", SWEEPS)
def test_each_ready_sweep_names_scenes(name: str) -> None:
    """The first and the last draw of a combination; the objects of both classes, but where one object is varied."""
    made = jobs(*params(name), chunk=1000)
    scenes: list[Scene] = []
    for job in (made[0], made[1], made[-1]):
        draws = re.findall(r"\d+", next((o for o in job if o.startswith("draw=")), ""))
        others = [o for o in of_user(job) if not o.startswith("draw=")]
        for draw in dict.fromkeys((draws[0], draws[-1]) if draws else ("-1",)):
            scenes.append(compose(f"+sweep={name}", *others, f"draw={draw}"))
    laws = {"fixed_corotated"} if name == "sensitivity" else {"fixed_corotated", "neo_hookean"}
    assert {scene.material.law for scene in scenes} == laws
    ids = [sample.scene_id(scene) for scene in scenes]
    assert len(set(ids)) == len(ids)
    if name == "table2":
        assert sum(len(re.findall(r"\d+", of_user(job)[-1])) for job in made) == 7020


# Leftovers, and two workers on one draw.


def test_leftovers_of_dead_processes_are_removed(tmp_path: Path) -> None:
    """Those of living processes stay, and those of other hosts for a day; a replaced sample gets its name back."""
    gone = subprocess.Popen(["true"])
    gone.wait()
    here, alive = socket.gethostname(), os.getppid()
    kept = [f"a.partial-{alive}@{here}", f"a.partial-{gone.pid}@elsewhere", "b.incomplete", "failures", "c"]
    dead = f"{gone.pid}@{here}"
    left = [f"a.partial-{dead}", f"a.partial-{gone.pid}.1@{here}", f"a.partial-{os.getpid()}@{here}",
            f"a.partial-{gone.pid}@another", f"c.replaced-{dead}", f"d.replaced-{dead}"]  # fmt: skip
    for name in (*kept, *left):
        (tmp_path / name).mkdir()
    os.utime(tmp_path / f"a.partial-{gone.pid}@another", times=(0, time.time() - folders.STALE - 1))
    assert sorted(folders.clear(tmp_path)) == sorted(left)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*kept, "d"])


def test_two_workers_on_one_draw_leave_one_sample(
    tmp_path: Path, taichi: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second one publishes at the same moment: between its look at the name and its renaming."""
    scene = compose(*SMALL, f"output.folder={tmp_path}")
    rename, seen = Path.rename, []

    def racing(path: Path, target: Any) -> Path:
        if ".partial-" in path.name and not seen:
            seen.append(path)
            shutil.copytree(path, target)
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", racing)
    outcome = pipeline.run(scene)
    assert seen
    assert outcome.sample().complete
    assert sample.verify(samples(tmp_path)[0]) == []
    assert [p.name for p in tmp_path.iterdir()] == [sample.scene_id(scene)]


# The display.


def test_a_line_a_clip_and_totals(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from hydra_plugins.hydra_fracsim.draws import Job

    scene = compose("asset=duck", "draw=3")
    shown = lines.Lines(Job(total=20, first=11, varied=["asset", "draw"], began=time.time() - 8 * 12), tmp_path, False)
    (tmp_path / "sweep.jsonl").write_text("{}\n" * 12)
    outcome = Outcome("complete", tmp_path, report={"break_frame": 41}, seconds={"simulate": 6.0})
    shown.done(Attempt(Task(scene, ("asset=duck", "draw=3")), "a", outcome, 8.1))
    assert capsys.readouterr().out == "12/20 duck draw 3: broke at frame 41, 8.1 s (simulate 6.0), left 1 min\n"
    summary = Summary()
    for status in ("complete", "suspect", "never breaks", "existing", "failed"):
        summary.counts[status] += 2
    lines.totals(summary, 360)
    assert capsys.readouterr().out == (
        "10 clips in 6 min: made 6 (suspect 2, never breaks 2), existing 2, failed 2, 60 clips/hour\n")  # fmt: skip


# Whole sweeps.

DRAWS = ("+sweep=table2", *ONE_THREAD, "asset=bread", "draw=0,1,702", "hydra.sweeper.chunk=1")
"""Two scenes and a draw that the table does not have."""


def arrays(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    """All recorded arrays of a sample."""
    clip = sample.read(path)
    return {"rgb": clip.rgb, "alpha": clip.alpha, "tracks": clip.tracks.xy, **clip.maps, **clip.history}


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sweep in one process; one scene fails, and the command says so."""
    folder = tmp_path_factory.mktemp("basic")
    done = fracsim_command(*DRAWS, f"output.folder={folder}")
    assert (done.returncode, len(samples(folder))) == (2, 2), done.stderr
    assert done.stderr.splitlines()[0].startswith("error: draw=702 is not in the parameter table")
    assert done.stderr.splitlines()[1:] == ["1 scene(s) failed"]
    names = [line.partition(": ")[0] for line in done.stdout.splitlines()]
    assert names[:3] == ["1/3 bread draw 0", "2/3 bread draw 1", "3/3 bread draw 702"]
    assert names[3].startswith("3 clips in ")
    return folder


def test_a_second_run_makes_nothing(reference: Path) -> None:
    before = {p: (p / "meta.json").stat().st_mtime_ns for p in samples(reference)}
    done = fracsim_command(*DRAWS, f"output.folder={reference}")
    assert "made 0 (suspect 0, never breaks 0), existing 2, failed 1" in done.stdout
    assert {p: (p / "meta.json").stat().st_mtime_ns for p in samples(reference)} == before
    assert {p.name for p in reference.iterdir()} == {*(p.name for p in before), "sweep.jsonl", "failures", "multirun"}


@pytest.mark.parametrize("launcher", WORKERS)
def test_every_launcher_makes_the_same_samples(launcher: str, reference: Path, tmp_path: Path) -> None:
    """With one thread bit for bit; a failure in a worker is counted and gives exit status 2."""
    pytest.importorskip(PACKAGES[launcher])
    if importlib.util.find_spec("hydra_plugins.hydra_submitit_launcher") is None and launcher != "ray":
        pytest.skip("the launchers of Hydra are not installed")
    done = fracsim_command(*[o for o in DRAWS if not o.startswith("backend")], f"hydra/launcher={launcher}",
                           *WORKERS[launcher], f"output.folder={tmp_path}")  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert "made 2 " in done.stdout
    assert "failed 1" in done.stdout
    assert "1 scene(s) failed" in done.stderr
    assert {p.name for p in samples(tmp_path)} == {p.name for p in samples(reference)}
    assert len(list((tmp_path / "failures").iterdir())) == 1
    for path in samples(reference):
        ours, theirs = arrays(path), arrays(tmp_path / path.name)
        assert sample.read(tmp_path / path.name).meta["backend"]["threads"] == 1
        assert set(ours) == set(theirs)
        for name, values in ours.items():
            np.testing.assert_array_equal(values, theirs[name], name)


def test_a_batch_system_stops_a_sweep_that_goes_on_later(tmp_path: Path) -> None:
    """SIGTERM during the first clip: exit status 130, how to go on, and the same command makes the rest."""
    command = ("+sweep=table2", *ONE_THREAD, "asset=bread", "draw=0,1", f"output.folder={tmp_path}")
    process = start(*command, start_new_session=True)
    while not list(tmp_path.glob("*.partial-*")):
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err == "interrupted: repeat the command to go on; finished samples are not made again\n"
    assert not list(tmp_path.glob("*.partial-*"))
    done = fracsim_command(*command)
    assert (done.returncode, len(samples(tmp_path))) == (0, 2), done.stderr
    assert journal.read(tmp_path)[0]["status"] == "interrupted"


def test_nothing_is_lost_by_five_kills(tmp_path: Path) -> None:
    """kill -9 of two processes on the same sweep, at random moments of their work."""
    counts = kill_study.study(tmp_path, kills=5, scenes=4)
    assert counts.kills + counts.ended >= 5
    assert (counts.whole, counts.broken, counts.left, counts.status) == (4, 0, 0, 0)
