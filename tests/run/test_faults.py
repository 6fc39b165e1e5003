"""Bad input, faults of the simulation, and interruptions: one clear error, and nothing is lost."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections import namedtuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from fracsim import __main__, compose, sample
from fracsim.mpm.state import State
from fracsim.run import pipeline, recorder
from fracsim.scene.program import SIMULATE
from tests.command import SMALL, fracsim_command, samples, start

BLOW_UP = ("solver.dt=0.01", "solver.dt_override=true", "material=rubber")
"""Six times the bound at rest: faster than solver.max_speed in the third substep."""


def words(error: str, *needed: str) -> None:
    """One line that starts with `error:` and has all that is needed."""
    lines = error.splitlines()
    assert [line[:7] for line in lines] == ["error: "], error
    for part in needed:
        assert part in lines[0], (part, lines[0])


@pytest.fixture
def complain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Any:
    """Runs the command with bad input in this process: it must end with status 2, one line and no file."""

    def no_work(*_: Any) -> None:
        pytest.fail("a substep was computed before the error")

    def complaint(*arguments: str, folder: Path = tmp_path / "out") -> str:
        monkeypatch.setattr(State, "run", no_work)
        monkeypatch.setattr(sys, "argv", ["fracsim", *SMALL, f"output.folder={folder}", *arguments])
        capfd.readouterr()
        with pytest.raises(SystemExit) as end:
            __main__.main()
        out, err = capfd.readouterr()
        assert (end.value.code, out) == (2, "")
        assert not list((tmp_path / "out").rglob("*"))
        return err

    return complaint


@pytest.mark.parametrize(
    ("arguments", "needed"),
    [
        # Keys, groups and types, which Hydra and OmegaConf find.
        ("material.Ee=3", "material.Ee=3|did you mean material.E?|--help"),
        ("camera.widht=64", "camera.widht=64|did you mean camera.width?"),
        ("speed=3", "speed=3|did you mean loading.speed?"),
        ("materal.E=3", "materal.E=3|did you mean material.E?"),
        ("lodaing.spede=3", "lodaing.spede=3|did you mean loading.speed?"),
        ("aset=duck", "aset=duck|did you mean asset?"),
        ("~material", "~material cannot be used|every scene has material"),
        ("~material.E", "~material.E cannot be used|leave it out"),
        ("bogus=3", "bogus=3|choose one of asset, backend, camera"),
        ("+bogus=3", "bogus=3|choose one of asset"),
        ("+material.bogus=3", "material.bogus=3|choose one of material.law, material.E, material.nu"),
        ("asset.foo.bar=1", "asset.foo.bar=1|choose one of asset.kind"),
        ("asset=dog", "asset=dog|choose one of bar, bear, bread"),
        ("quality=best", "quality=best|choose one of default, paper, preview, reference"),
        ("material.E=soft", "material.E=soft|a number in [100, 1e9] Pa|Try material.E=6000"),
        ("material.E=null", "material.E=null|a number in [100, 1e9] Pa"),
        ("solver.cells=100.5", "solver.cells=100.5|a whole number in [8, 2000]|Try solver.cells=150"),
        ("capture.rgb=maybe", "capture.rgb=maybe|true or false|Try capture.rgb=true"),
        ("capture.maps=damage", "capture.maps=damage|a list|Try capture.maps=[flow,"),
        ("asset.rotate_deg=[a,b]", "asset.rotate_deg=[a,b]|a list, each item a number|Try asset.rotate_deg=[0,0,0]"),
        ("duck", "duck cannot be read|field=value"),
        ("asset.interior=#aabbcc", "asset.interior=#aabbcc cannot be read|quotes"),
        ("material=3", "material=3 cannot be used|--help"),
        ("+material.E=3e3", "+material.E=3e3 cannot be used|Either remove + prefix"),
        ("asset.path=${nowhere}", "asset.path=${nowhere} cannot be used|'nowhere' not found"),
        # Values out of range.
        ("material.E=1", "material.E=1 is|[100, 1e9] Pa|Try material.E="),
        ("material.E=nan", "material.E=nan is|[100, 1e9] Pa"),
        ("material.nu=0.5", "material.nu=0.5 is|[0, 0.499]"),
        ("fracture.onset=0.9", "fracture.onset=0.9 is|[1, 10]"),
        ("fracture.crit=1.2", "fracture.crit=1.2|greater than fracture.onset=1.5|Raise fracture.crit"),
        ("loading.speed=0", "loading.speed=0 is|(0, 20] m/s|Try loading.speed=0.6"),
        ("loading.speed=-1", "loading.speed=-1 is|(0, 20] m/s"),
        ("loading.grips=ridgid", "loading.grips=ridgid|Try loading.grips=rigid"),
        ("loading.gravity=[1,2]", "loading.gravity=[1.0, 2.0]|three components"),
        ("loading.offset=0.01", "loading.offset=0.01|loading.offset above 0.025"),
        ("solver.dt=tiny", "solver.dt=tiny|auto or a number in (0, 1]|Try solver.dt=auto"),
        ("seed=-1", "seed=-1|[0, 2147483647]"),
        ("draw=x", "draw=x|a whole number|Try draw=-1"),
        ("draw=-2", "draw=-2 is|[-1, inf)|Try draw=-1"),
        ("draw=702", "draw=702 is not in the parameter table|18 materials x 39 loadings|between 0 and 701"),
        ("draw=0 space.per_material=193", "space.per_material=193 is more than the 192|lower space.per_material"),
        ("draw=0 space.materials=3", "space.materials=3|a mapping"),
        ("draw=0 +space.materials.typo=[1]", "typo=1 is not a field of a scene"),
        ("draw=0 +space.loadings.loading=[{speed:99}]", "loading.speed=99 is|(0, 20] m/s"),
        ("camera.width=100", "camera.width=100|a multiple of 16"),
        ("capture.frames=0", "capture.frames=0|[1, 10000]"),
        ("backend.arch=opencl", "backend.arch=opencl|cpu, cuda, vulkan, metal"),
        ("output=out", "output=out cannot be used|set one of its fields, output.folder, output.overwrite"),
        ("asset.name=duk", "asset.name=duk is not known|choose one of bar, bear|Did you mean duck?"),
        # Names of plug-ins, and what only the object or the solver can tell.
        ("material.law=jelly", "material.law=jelly|fixed_corotated, neo_hookean"),
        ("fracture.law=jelly", "fracture.law=jelly|choose one of stretch"),
        ("capture.maps=[heat]", "capture.maps=heat|damage, flow, strain, stress"),
        ("capture.maps=[flow,flow]", "capture.maps=['flow', 'flow']|name each once"),
        ("asset=mesh", "asset.path is empty|asset.path=FILE"),
        ("asset=mesh asset.path=gone.glb", "asset.path=gone.glb|No such file"),
        ("asset.max_particles=50", "asset.max_particles=50|lower solver.cells"),
        ("loading.offset=0.5", "loading.offset=0.5|grip holds no particle|smaller loading.offset"),
        ("solver.dt=0.05", "solver.dt=0.05|stability bound|solver.dt=auto"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_with_field_value_and_way_out(arguments: str, needed: str, complain: Any) -> None:
    words(complain(*arguments.split()), *needed.split("|"))


def test_bad_meshes_name_the_file(tmp_path: Path, complain: Any) -> None:
    """Without faces, with a vertex that is not a number, not a mesh at all, and one that needs too many particles."""
    ball = trimesh.creation.icosphere(2)
    files = {name: tmp_path / name for name in ("empty.obj", "nan.obj", "text.glb", "ball.obj")}
    files["empty.obj"].write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    ball.export(files["ball.obj"])
    rows = files["ball.obj"].read_text().splitlines(keepends=True)
    first = next(i for i, row in enumerate(rows) if row.startswith("v "))
    files["nan.obj"].write_text("".join([*rows[:first], "v nan 0 0\n", *rows[first + 1 :]]))
    files["text.glb"].write_text("hello")
    complaints = {"empty.obj": "no triangles", "nan.obj": "not finite", "text.glb": "cannot be read as glTF"}
    for name, word in complaints.items():
        words(complain("asset=mesh", f"asset.path={files[name]}"), f"asset.path={files[name]}", word)
    huge = complain("asset=mesh", f"asset.path={files['ball.obj']}", "asset.max_particles=100")
    words(huge, "asset.max_particles=100", "particles", "lower solver.cells or asset.size")
    red = complain("asset=mesh", f"asset.path={files['ball.obj']}", "asset.interior=red")
    words(red, "asset.interior=red", "#rrggbb")


def test_a_ply_that_is_no_checkpoint_is_refused(tmp_path: Path, complain: Any) -> None:
    """A mesh in PLY, and a broken file."""
    mesh, broken = (tmp_path / name for name in ("mesh.ply", "broken.ply"))
    trimesh.creation.icosphere(1).export(mesh)
    broken.write_text("ply\nformat ascii 1.0\nelement vertex 3\n")
    words(complain("asset=ply", f"asset.path={mesh}"), f"asset.path={mesh}", "not a 3DGS checkpoint", "asset.kind=mesh")
    words(complain("asset=ply", f"asset.path={broken}"), f"asset.path={broken}", "cannot be read as PLY")


def test_output_that_cannot_be_written(tmp_path: Path, complain: Any) -> None:
    (tmp_path / "file").write_text("")
    taken = tmp_path / "file" / "out"
    words(complain(folder=taken), f"output.folder={taken}", "cannot be written to", "set output.folder")


def test_output_that_is_full(tmp_path: Path, complain: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage(10**9, 10**9 - 1000, 1000))
    words(complain(), f"output.folder={tmp_path / 'out'}", "0 MB free", "lower capture.frames")


def test_a_backend_that_is_not_there(tmp_path: Path) -> None:
    """Taichi would fall back to the CPU, and complain in its own words."""
    from taichi._lib import core

    if core.with_cuda():
        pytest.skip("CUDA is there")
    done = fracsim_command("backend.arch=cuda", f"output.folder={tmp_path / 'out'}")
    assert (done.returncode, done.stdout, (tmp_path / "out").exists()) == (2, "", False)
    words(done.stderr, "backend.arch=cuda is not available", "use backend.arch=cpu")


def test_python_gets_the_same_errors() -> None:
    """`compose` raises ValueError, whatever Hydra raises."""
    with pytest.raises(ValueError, match=r"material\.Ee=3 is not a field.*did you mean material\.E\?"):
        compose("material.Ee=3")
    with pytest.raises(ValueError, match=r"asset=dog is not known"):
        compose("asset=dog")
    with pytest.raises(ValueError, match=r"material\.nu=0\.5 is not allowed"):
        compose("material.nu=0.5")
    with pytest.raises(ValueError, match=r"material=3 cannot be used: .* See python -m fracsim --help\."):
        compose("material=3")


def test_a_scene_that_blows_up_keeps_what_was_filmed(tmp_path: Path) -> None:
    """The error names frame, substep, particle, field and cause; the frames before it are readable and marked."""
    done = fracsim_command(*SMALL, *BLOW_UP, "capture.frames=10", f"output.folder={tmp_path}")
    assert done.returncode == 2
    words(done.stderr, "solver.max_speed=500", "the substep is too long: use solver.dt=auto")
    assert re.search(r"frame \d+, substep \d+, particle \d+ at \[.*\] m: field v = \d+", done.stderr)
    (path,) = samples(tmp_path)
    kept = check_incomplete(path, reason=r"frame \d+, substep \d+, particle \d+")
    assert f"Kept: {kept} of 10 frames, in {path}." in done.stderr
    assert re.search(rf"INCOMPLETE +{kept} of 10 frames", done.stdout)


def test_crushed_particles_stop_the_run(tmp_path: Path) -> None:
    outcome = pipeline.run(compose(*SMALL, *BLOW_UP, "solver.max_speed=1e5", f"output.folder={tmp_path}"))
    assert outcome.status == "failed"
    with pytest.raises(RuntimeError, match=r"frame \d+.*particle \d+ \(field F, J = .*below 0\.05.*solver\.dt=auto"):
        outcome.sample()
    check_incomplete(samples(tmp_path)[0], reason=r"below 0\.05")


def check_incomplete(path: Path, reason: str) -> int:
    """An unfinished sample that says why and whose frames can be read; returns their number."""
    with pytest.raises(ValueError, match="is incomplete"):
        sample.read(path)
    clip = sample.read(path, allow_incomplete=True)
    assert path.name.endswith(".incomplete")
    assert (clip.complete, clip.meta["complete"]) == (False, False)
    assert re.search(reason, clip.meta["reason"]), clip.meta["reason"]
    assert len(clip.rgb) == len(clip.alpha) == len(clip.maps["stress"]) == clip.frames >= 1
    assert np.isfinite(clip.maps["stress"]).all()
    return clip.frames


def started(folder: Path, *overrides: str) -> "subprocess.Popen[str]":
    """A run of 3,000 short frames in a session of its own, once three of them are written."""
    process = start(*SMALL, "capture.frames=3000", "capture.fps=3000", f"output.folder={folder}", *overrides,
                    start_new_session=True)  # fmt: skip
    for _ in range(600):
        journals = list(folder.glob("*.partial-*/frames.jsonl"))
        if journals and journals[0].read_text().count("\n") >= 3:
            return process
        assert process.poll() is None, process.communicate()
        time.sleep(0.1)
    raise AssertionError("no frame was written within a minute")


def test_ctrl_c_leaves_what_was_filmed(tmp_path: Path) -> None:
    process = started(tmp_path)
    os.killpg(process.pid, signal.SIGINT)  # as the terminal does: to its children too
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    said = [line for line in err.splitlines() if not line.startswith("frame ")]  # a sign of life on slow machines
    assert said == ["interrupted: repeat the command to go on; finished samples are not made again"]
    (path,) = samples(tmp_path)
    assert check_incomplete(path, reason="interrupted by the user") >= 3
    assert f"{path}\n" in out


def test_a_killed_run_is_never_taken_for_a_sample(tmp_path: Path) -> None:
    """kill -9 leaves a folder under a temporary name: readable as incomplete, not in the way of the next attempt."""
    process = started(tmp_path, "backend.threads=1")
    process.kill()
    process.communicate(timeout=60)
    (left,) = samples(tmp_path)
    meta = json.loads((left / "meta.json").read_text())
    assert ".partial-" in left.name
    assert (meta["complete"], "killed" in meta["reason"]) == (False, True)
    assert sample.read(left, allow_incomplete=True).frames >= 2
    scene = compose(*SMALL, "capture.frames=3000", "capture.fps=3000", f"output.folder={tmp_path}")
    assert sample.find(scene.output, sample.scene_id(scene)) is None
    assert pipeline.run(compose(*SMALL, f"output.folder={tmp_path}")).sample().complete


def test_a_second_attempt_takes_the_place_of_an_interrupted_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Interrupted while the second frame is filmed, then run to the end."""
    scene = compose(*SMALL, f"output.folder={tmp_path}")
    shoot = recorder.Film.shoot

    def interrupting(film: recorder.Film, frame: Any, particles: Any) -> Any:
        if frame.index == 1:
            raise KeyboardInterrupt
        return shoot(film, frame, particles)

    with monkeypatch.context() as patch:
        patch.setattr(recorder.Film, "shoot", interrupting)
        outcome = pipeline.run(scene)
    assert (outcome.status, outcome.path, outcome.frames) == ("interrupted", samples(tmp_path)[0], 1)
    assert check_incomplete(samples(tmp_path)[0], reason="interrupted by the user") == 1
    outcome = pipeline.run(scene)
    assert samples(tmp_path) == [outcome.path]
    assert outcome.sample().complete


def test_an_interruption_before_the_first_frame_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupting(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(recorder.Film, "shoot", interrupting)
    outcome = pipeline.run(compose(*SMALL, f"output.folder={tmp_path}"))
    assert (outcome.status, outcome.path, outcome.report) == ("interrupted", None, {})
    assert not list(tmp_path.iterdir())


def test_errors_that_hydra_words_in_several_lines_are_one() -> None:
    message = SIMULATE.explain(ValueError("first\n  second"), ["a=1"])
    assert message == "a=1 cannot be used: first second. See python -m fracsim --help."
