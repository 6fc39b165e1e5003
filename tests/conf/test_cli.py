"""The commands of the documents, as a user types them, on scenes of about two thousand particles."""

import io
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from rich.console import Console

from fracsim import Scene, __main__, compose, registry, sample
from fracsim.asset import ply
from fracsim.run import console, pipeline
from fracsim.scene.knob import describe
from fracsim.scene.program import SIMULATE
from tests.command import SMALL, fracsim_command, samples

ROOT = Path(__file__).parents[2]
DUCK = Path("../shared/data/Duck.glb")


def run(folder: Path, *arguments: str) -> tuple[str, Path]:
    """What the command says, and the newest sample; it must succeed and complain of nothing."""
    done = fracsim_command(*arguments, *SMALL, f"output.folder={folder}", cwd=ROOT)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout, samples(folder)[-1]


def textured(path: Path) -> str:
    """A mesh of our own with a texture: a slab, its left half red and its right half blue."""
    slab = trimesh.creation.box((0.6, 0.2, 0.2)).subdivide().subdivide()
    image = np.zeros((8, 8, 3), np.uint8)
    image[:, :4, 0] = image[:, 4:, 2] = 220
    uv = slab.vertices[:, :2] / slab.extents[:2] + 0.5
    slab.visual = trimesh.visual.TextureVisuals(uv, image=Image.fromarray(image))
    slab.export(path)
    return str(path)


@pytest.fixture(scope="module")
def default(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """`python -m fracsim`: what it says, and its sample."""
    return run(tmp_path_factory.mktemp("default"))


def test_the_default_scene_is_a_whole_sample(default: tuple[str, Path]) -> None:
    clip = sample.read(default[1])
    assert clip.complete
    assert sample.verify(default[1]) == []
    assert (clip.scene.asset.kind, clip.scene.asset.name, clip.scene.backend.arch) == ("builtin", "bread", "cpu")
    assert clip.rgb.shape == (4, 64, 64, 3)
    assert set(clip.maps) == {"flow", "strain", "stress", "damage"}
    assert clip.tracks.xy.shape == (4, 16, 2)
    assert np.ptp(clip.rgb[0], axis=(0, 1)).min() > 50  # something is seen on the white ground
    assert (default[1] / "strip.mp4").is_file()
    assert (default[1] / "report.png").is_file()


def test_the_table_at_the_end(default: tuple[str, Path]) -> None:
    """One row a fact, the path last and in one piece, and nothing of the libraries underneath."""
    said, path = default
    clip = sample.read(path)
    labels = [re.split(r"\s{2,}", line)[0] for line in said.splitlines() if line and line[0] != " "]
    assert labels == ["object", "break", "a uniform bar", "largest stretch", "damaged / failed", "peak load",
                      "substeps", "energy [J]", "seconds", "sample", "to watch"]  # fmt: skip
    assert f"bread, {clip.meta['report']['particles']:,} particles" in said
    assert f"{path}\n" in said
    assert f"{path / 'strip.mp4'}\n" in said
    assert "Taichi" not in said


def test_a_sample_that_is_there_is_not_made_again(default: tuple[str, Path]) -> None:
    before = (default[1] / "meta.json").stat()
    said, path = run(default[1].parent)
    after = (path / "meta.json").stat()
    assert said == f"{path} is already there and whole; output.overwrite=true makes it again\n"
    assert (path, after.st_mtime_ns, after.st_ino) == (default[1], before.st_mtime_ns, before.st_ino)


def test_a_mesh(tmp_path: Path) -> None:
    file = str(DUCK) if (ROOT / DUCK).exists() else textured(tmp_path / "slab.glb")
    said, path = run(tmp_path / "out", "asset=mesh", f"asset.path={file}", "material=rubber",
                     "loading.axis_deg=30", "loading.speed=0.8")  # fmt: skip
    scene = sample.read(path).scene
    assert Path(file).name in said
    assert (scene.asset.kind, scene.material.law, scene.fracture.onset) == ("mesh", "neo_hookean", 2.6)
    assert (scene.loading.axis_deg, scene.loading.speed) == (30.0, 0.8)
    # It moves along the tearing axis, and what moves up is to the right: the flow is (right, up, ahead).
    flow = sample.read(path).maps["flow"][-1]
    right, up = flow[..., 0].sum(axis=0), flow[..., 1].sum(axis=0)
    assert right[40:].sum() > 0 > right[:24].sum()
    assert up[40:].sum() > 0 > up[:24].sum()


def test_a_trained_checkpoint(tmp_path: Path) -> None:
    """A shell of 4,000 flat red Gaussians on a sphere of radius 1, in the layout of 3DGS."""
    i = np.arange(4000) + 0.5
    y, turn = 1 - i / 2000, np.pi * (1 + 5**0.5) * i
    N = np.stack([np.sqrt(1 - y * y) * np.cos(turn), y, np.sqrt(1 - y * y) * np.sin(turn)], axis=1)
    A = 0.03**2 * np.eye(3) + (0.005**2 - 0.03**2) * N[:, :, None] * N[:, None, :]
    sh = np.tile(np.array([1.4, -1.4, -1.4]), (len(N), 1, 1))  # 0.5 + 0.282 sh: red
    ply.write(tmp_path / "point_cloud.ply", N, ply.triangle(A), np.full(len(N), 0.9), sh)
    _, path = run(tmp_path / "out", "asset=ply", f"asset.path={tmp_path / 'point_cloud.ply'}")
    clip = sample.read(path)
    assert (clip.scene.asset.kind, clip.complete) == ("ply", True)
    red, green, blue = clip.rgb[0, 32, 32]
    assert red > 150 > max(green, blue)


def test_one_map_without_colour_in_preview_on_one_thread(tmp_path: Path) -> None:
    _, path = run(tmp_path, "quality=preview", "capture.maps=[damage]", "capture.rgb=false", "backend.threads=1")
    clip = sample.read(path)
    assert (clip.scene.quality, clip.scene.backend.threads) == ("preview", 1)
    assert list(clip.maps) == ["damage"]
    assert clip.maps["damage"].shape == (4, 64, 64, 1)
    assert not (path / "rgb.mkv").exists()
    with pytest.raises(ValueError, match=r"capture\.rgb=false"):
        _ = clip.rgb


def test_a_sweep_makes_a_sample_a_scene_in_one_process(tmp_path: Path) -> None:
    """-m may stand anywhere; a line a clip; a bad scene is named, and the others are made all the same."""
    done = fracsim_command(*SMALL, "-m", "material.E=2e3,1,6e3", f"output.folder={tmp_path}")
    assert [sample.read(p).scene.material.E for p in samples(tmp_path)] == [2e3, 6e3]
    said = done.stdout.splitlines()
    assert [line.partition(": ")[0] for line in said[:3]] == [
        "1/3 bread material.E=2000.0", "2/3 material.E=1", "3/3 bread material.E=6000.0"]  # fmt: skip
    assert re.fullmatch(r"3 clips in \d+ \w+: made 2 .*, failed 1, \d+ clips/hour", said[3])
    assert (done.returncode, done.stderr.splitlines()[0][:20]) == (2, "error: material.E=1 ")
    assert done.stderr.splitlines()[1:] == ["1 scene(s) failed"]


def test_scenes_of_one_process_share_their_kernels(tmp_path: Path) -> None:
    """Scenes of other numbers, object and speed compile nothing: Taichi counts its compiled kernels.

    The second scene still compiles those that clear the arrays of the first.
    """
    from taichi.lang import impl

    from fracsim.mpm.kernels import substeps

    def film(*overrides: str) -> tuple[int, int]:
        pipeline.run(compose(*SMALL, *overrides, f"output.folder={tmp_path}"))
        return impl.get_runtime().get_num_compiled_functions(), substeps.cache_info().currsize

    film("material.E=2e3")
    once = film("material.E=4e3")
    assert once == film("material.E=6e3") == film("asset=bar", "material=bread", "loading.speed=1.1", "seed=3")
    assert once < film("asset=bar", "material=rubber_decoupled")  # another law, used nowhere else here, is other code


def test_help_names_every_field_value_range_and_group() -> None:
    done = fracsim_command("--help")
    said = " ".join(done.stdout.split())  # long entries are wrapped
    assert (done.returncode, done.stderr) == (0, "")
    for name, _, knob in describe(Scene):
        assert f" {name}=" in said, name
        assert " ".join(knob.doc.split()) in said, name
        assert f"{{{knob.allowed()}}}" in said or not knob.allowed(), name
    for package in ("fracsim.asset.objects", "fracsim.constitutive", "fracsim.damage", "fracsim.maps"):
        assert f"{{{' | '.join(registry.names(package))}}}" in said
    for group in (*SIMULATE.groups, *SIMULATE.optional):
        for file in (ROOT / "conf" / group).glob("*.yaml"):
            assert re.search(rf"\b{group} [\w, ]*\b{file.stem}\b", said), file
    assert "$" not in said
    assert "material.viscosity=44.444444 " in said  # that of the default scene, not of the bare schema
    assert max(map(len, done.stdout.splitlines())) <= 100  # COLUMNS of these tests


def test_the_progress_bar_tells_rate_substep_and_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Console(force_terminal=True, width=80, file=io.StringIO())
    monkeypatch.setattr(console, "OUT", screen)
    with console.progress(Scene()) as progress:
        progress.frame(0)
        progress._since -= 1  # a second ago
        progress.substeps(1000, 2.5e-4, 0.25)
        progress._bar.refresh()
    assert isinstance(screen.file, io.StringIO)
    shown = re.sub(r"\x1b\[[0-9;?]*\w", "", screen.file.getvalue())
    assert re.search(r"frame 1 .* 26% +[-:0-9]+ left +\d+ substeps/s +dt 2\.50e-04 s", shown), shown


@pytest.mark.parametrize("flag", ["-m", "--multirun"])
def test_the_flag_of_a_sweep_may_stand_between_overrides(flag: str, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    monkeypatch.setattr(__main__, "run", lambda: seen.extend(sys.argv[1:]))
    monkeypatch.setattr(sys, "argv", ["fracsim", "asset=bar", flag, "material.E=2e3,6e3"])
    __main__.main()
    assert seen == [flag, "asset=bar", "material.E=2e3,6e3"]


def test_the_identity_of_a_sample_does_not_know_where_it_was_made() -> None:
    scene = compose(*SMALL)
    elsewhere = replace(scene, backend=compose("backend.threads=7").backend, output=compose("output.folder=x").output)
    assert sample.scene_id(scene) == sample.scene_id(elsewhere)
