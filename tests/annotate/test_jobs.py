"""Simulations that a page starts: one at a time, in order, to be cancelled, and never the end of the server."""

import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from fracgen.annotation import commands, jobs
from fracgen.annotation.commands import Task
from tests.annotate.photos import photo
from tests.annotate.serving import Tab, command, saying, served

LONG = 60.0
"""Seconds that a job would take that is to be cancelled."""


@pytest.fixture(scope="module", name="film")
def film_fixture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "strip.mp4"
    path.write_bytes(b"a film of twenty bytes")
    return path


@pytest.fixture(scope="module", name="loaf")
def loaf_fixture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return photo(tmp_path_factory.mktemp("loaf") / "loaf.png", 64, 48)


def opened(client: TestClient, loaf: Path) -> Tab:
    """A tab with a picture."""
    tab = Tab(client)
    assert tab.upload(loaf).status_code == 200
    return tab


@pytest.fixture(name="slow")
def slow_fixture(film: Path) -> Iterator[TestClient]:
    """A page whose simulations take a minute."""
    with served(simulate=command(film, steps=2, pause=LONG / 2)) as client:
        yield client


def gone(pid: int) -> bool:
    """Whether a process has ended, within a few seconds."""
    for _ in range(100):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def running(client: TestClient) -> Any:
    """The process of the job that runs."""
    queue = client.app.state.place.queue  # type: ignore[attr-defined]
    return next(job.process for job in queue._jobs if job.state == "running")


def test_a_simulation_gives_a_film(film: Path, loaf: Path) -> None:
    with served(simulate=command(film)) as client:
        tab = opened(client, loaf)
        assert tab.start().json()["state"] in ("waiting", "running")
        done = tab.wait("done", "failed")
        assert (done["state"], done["done"]) == ("done", 1.0)
        assert done["text"] == "at frame 2 (t = 0.02 s)"
        shown = tab.get(f"jobs/{done['id']}/film.mp4")
        assert shown.content == film.read_bytes()
        part = tab.request("GET", f"jobs/{done['id']}/film.mp4", headers={"range": "bytes=2-5"})
        assert (part.status_code, part.content) == (206, film.read_bytes()[2:6])


def test_progress_is_the_part_of_the_frames(slow: TestClient, loaf: Path) -> None:
    tab = opened(slow, loaf)
    tab.start()
    for _ in range(200):
        if tab.jobs()[0]["done"]:
            break
        time.sleep(0.05)
    (job,) = tab.jobs()
    assert (job["done"], job["text"]) == (0.5, "frame 1 of 2, 1 s left")


def test_one_runs_at_a_time_and_others_wait_and_can_be_cancelled(slow: TestClient, loaf: Path) -> None:
    one, other = opened(slow, loaf), opened(slow, loaf)
    one.start()
    one.wait("running")
    other.start()
    other.start("simulate", E=1e4)
    assert [(job["state"], job["before"]) for job in other.jobs()] == [("waiting", 1), ("waiting", 2)]
    assert other.request("DELETE", f"jobs/{other.jobs()[0]['id']}").status_code == 200
    assert [job["state"] for job in other.jobs()] == ["cancelled", "waiting"]
    process = running(slow)
    one.request("DELETE", f"jobs/{one.jobs()[0]['id']}")
    assert one.jobs()[0]["state"] == "cancelled"
    assert gone(process.pid)
    assert other.wait("running", job=1)


def test_a_tab_cannot_see_or_cancel_the_jobs_of_another(slow: TestClient, loaf: Path) -> None:
    one, other = opened(slow, loaf), opened(slow, loaf)
    job = one.start().json()["id"]
    assert other.jobs() == []
    assert other.request("DELETE", f"jobs/{job}").status_code == 404
    assert other.get(f"jobs/{job}/film.mp4").status_code == 404
    assert one.wait("running")


def test_a_tab_that_closes_takes_its_jobs_along(slow: TestClient, loaf: Path) -> None:
    one, other = opened(slow, loaf), opened(slow, loaf)
    one.start()
    one.wait("running")
    other.start()
    process = running(slow)
    one.request("POST", "end")
    assert gone(process.pid)
    assert other.wait("running")


def test_the_queue_has_an_end(slow: TestClient, loaf: Path) -> None:
    tab = opened(slow, loaf)
    tab.start()
    tab.wait("running")
    for _ in range(jobs.WAITING):
        assert tab.start().status_code == 200
    assert tab.start().status_code == 429


def test_a_job_that_is_killed_has_failed_and_the_next_one_runs(slow: TestClient, loaf: Path) -> None:
    tab = opened(slow, loaf)
    tab.start()
    tab.wait("running")
    tab.start()
    os.kill(running(slow).pid, signal.SIGKILL)
    failed = tab.wait("failed", job=0)
    assert failed["text"] == "The process was ended by signal 9."
    assert tab.wait("running", job=1)


def test_a_job_that_ignores_the_request_to_end_is_ended(loaf: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs, "PATIENCE", 0.5)
    deaf = (
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); time.sleep(60)"
    )
    with served(simulate=saying(deaf)) as client:
        tab = opened(client, loaf)
        job = tab.start().json()["id"]
        for _ in range(200):
            if tab.jobs()[0]["text"] == "deaf":
                break
            time.sleep(0.05)
        process = running(client)
        tab.request("DELETE", f"jobs/{job}")
        assert gone(process.pid)


@pytest.mark.parametrize(("code", "words"), [
    ("print('frame 1 of 9'); raise SystemExit('error: material.E=1 is not allowed')", "material.E=1 is not allowed"),
    ("raise RuntimeError('bug')", "RuntimeError: bug"), ("import sys; sys.exit(3)", "ended with status 3 and no word"),
    ("print('fine')", "without a film"), ("print('x' * 10**6); raise SystemExit(1)", "xxx"),
    (r"import os; os.write(1, b'\xff\xfe\n'); raise SystemExit(1)", "\ufffd"),
])  # fmt: skip
def test_a_job_that_fails_says_why(code: str, words: str, loaf: Path) -> None:
    with served(simulate=saying(code)) as client:
        tab = opened(client, loaf)
        tab.start()
        failed = tab.wait("failed")
        assert words in failed["text"]
        assert len(failed["text"]) < 3000
        assert tab.get(f"jobs/{failed['id']}/film.mp4").status_code == 404


def test_a_command_that_is_not_there_is_a_failure(loaf: Path) -> None:
    with served(simulate=lambda task: ["/no/such/program"]) as client:
        tab = opened(client, loaf)
        tab.start()
        assert "cannot be started" in tab.wait("failed")["text"]


def test_when_the_server_ends_so_do_its_jobs_and_its_files_go(film: Path, loaf: Path) -> None:
    with served(simulate=command(film, steps=2, pause=LONG)) as client:
        tab = opened(client, loaf)
        tab.start()
        tab.wait("running")
        process, folder = running(client), client.app.state.place.folder  # type: ignore[attr-defined]
        assert folder.is_dir()
    assert gone(process.pid)
    assert not folder.exists()


def test_a_job_keeps_the_condition_with_which_it_was_started(film: Path, loaf: Path) -> None:
    asked: list[Task] = []

    def noting(task: Task) -> list[str]:
        asked.append(task)
        return list(command(film)(task))

    with served(simulate=noting) as client:
        tab = opened(client, loaf)
        tab.start(E=7e3, category="high_stretch", onset=3.0, crit=4.0)
        tab.wait("done")
        tab.start(E=8e3)
        tab.wait("done", job=1)
    assert asked[0].condition != asked[1].condition
    assert (asked[0].category, asked[1].category) == ("high_stretch", "low_stretch")


def test_without_a_checkpoint_the_generator_is_refused_and_with_one_it_runs(film: Path, loaf: Path) -> None:
    with served() as client:
        tab = opened(client, loaf)
        answer = tab.start("generate")
        assert (answer.status_code, "--run" in answer.json()["error"]) == (422, True)
    with served(generate=command(film)) as client:
        assert client.get("/setup").json()["no_generator"] == ""
        tab = opened(client, loaf)
        tab.start("generate")
        assert tab.wait("done")["kind"] == "generate"


def test_the_commands_are_those_that_one_types(tmp_path: Path) -> None:
    task = Task(tmp_path / "a.png", tmp_path / "m.png", tmp_path / "c.json", "high_stretch", "crop", tmp_path / "out")
    simulate = commands.simulate(task)
    assert simulate[:4] == [sys.executable, "-m", "fracsim", "asset=image"]
    assert {f"asset.path={task.picture}", f"asset.mask={task.mask}", f"condition={task.condition}", "material=rubber",
            "quality=preview", "camera.background=photo", f"output.folder={task.output}"} < set(simulate)  # fmt: skip
    generate = commands.Generate("runs/x", ("vae=tiny", "seed=3"))(task)
    assert generate[:4] == [sys.executable, "-m", "fracgen.sample", "run=runs/x"]
    shown = {f"image={task.picture}", f"mask={task.mask}", f"condition={task.condition}", "fit=crop"}
    assert shown | {"vae=tiny", "seed=3"} < set(generate)
    assert f"mask={task.mask}" not in commands.Generate("runs/x", ("cutout=none",))(task)
