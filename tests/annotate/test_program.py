"""`python -m fracgen.annotate`: its options, its errors, its end, and the real commands that it starts."""

import builtins
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from fracgen import annotate
from fracgen.annotation import checkpoint, commands
from fracgen.annotation.commands import Task
from fracgen.annotation.preview import Size
from fracsim.scene import condition as condition_file
from fracsim.scene.condition import Condition
from tests.annotate.photos import photo
from tests.annotate.serving import Tab, served
from tests.command import environment


def started(*arguments: str, folder: Path) -> "subprocess.Popen[str]":
    """The program, with its temporary files in a folder."""
    return subprocess.Popen([sys.executable, "-m", "fracgen.annotate", "--no-browser", "--port", "0", *arguments],
                            env=environment(TMPDIR=str(folder)), text=True, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE)  # fmt: skip


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_prints_where_it_is_and_ends_without_a_trace(number: int, tmp_path: Path) -> None:
    process = started(folder=tmp_path)
    assert process.stdout is not None
    address = process.stdout.readline().split()[0]
    assert address.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(address) as answer:
        assert b"Annotate a pull" in answer.read()
    assert list(tmp_path.iterdir()) != []
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "")
    assert list(tmp_path.iterdir()) == []


def test_only_this_machine_can_connect() -> None:
    with annotate.listening(0) as server:
        assert server.getsockname()[0] == "127.0.0.1"


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The error of a command that cannot work."""
    assert annotate.main(["--no-browser", *arguments]) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    return err


def test_errors_name_what_is_wrong(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert "neither an image nor a folder" in told(capsys, str(tmp_path / "nowhere"))
    assert "holds no image" in told(capsys, str(tmp_path))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert "give another, or --port 0" in told(capsys, "--port", str(taken.getsockname()[1]))
    for wrong in (["--port", "70000"], ["--set", "seed=1"]):
        with pytest.raises(SystemExit):
            annotate.main(wrong)


def test_without_the_extra_one_error_says_what_to_install(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name == "uvicorn":
            raise ModuleNotFoundError("No module named 'uvicorn'", name="uvicorn")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    assert "pip install 'fracsim[ui]'" in told(capsys)


def test_a_folder_without_a_checkpoint_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    pytest.importorskip("torch")
    assert "has no trained.safetensors" in told(capsys, "--run", str(tmp_path))
    (tmp_path / "trained.safetensors").write_bytes(b"broken")
    assert "cannot be read" in told(capsys, "--run", str(tmp_path))


def test_the_generator_is_started_with_a_real_checkpoint(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    from tests.gen import sampling_run as small

    run = small.write_run(tmp_path / "run")
    assert checkpoint.size(str(run)) == Size(small.FRAMES, small.HEIGHT, small.WIDTH, 100.0)
    vae = ["vae=tiny", "vae.kind=wan", f"vae.base_dim={small.VAE.base_dim}", "vae.dim_mult=[1,1,1,1]",
           f"vae.res_blocks={small.VAE.res_blocks}"]  # fmt: skip
    overrides = (*vae, "encoders=tiny", "sampler=preview", "sampler.steps=2")
    with served(generate=commands.Generate(str(run), overrides), size=checkpoint.size(str(run))) as client:
        tab = Tab(client)
        tab.upload(photo(tmp_path / "loaf.png"))
        tab.start("generate")
        done = tab.wait("done", "failed", seconds=240)
        assert done["state"] == "done", done
        assert tab.get(f"jobs/{done['id']}/film.mp4").content[4:8] == b"ftyp"


def test_a_photo_is_really_simulated(tmp_path: Path) -> None:
    """The command of the page with coarse cells and a few frames; the condition sets the scene."""
    small = ["solver.cells=30", "capture.frames=4", "camera.width=64", "camera.height=64", "capture.tracks=0"]

    def simulate(task: Task) -> list[str]:
        return [*commands.simulate(task), *small]

    value = Condition(grips=[0.35, 0.53, 0.65, 0.53], E=7e3)
    with served(simulate=simulate) as client:
        tab = Tab(client)
        tab.upload(photo(tmp_path / "loaf.png"))
        content = condition_file.text(value)
        assert tab.request("POST", "jobs/simulate", content=content, params={"fit": "fit"}).status_code == 200
        done = tab.wait("done", "failed", seconds=240)
        assert done["state"] == "done", done
        assert "frame" in done["text"] or "holds" in done["text"]
        (scene,) = client.app.state.place.folder.glob("*/simulate-*/out/*/scene.yaml")  # type: ignore[attr-defined]
        assert "E: 7000.0" in scene.read_text()
