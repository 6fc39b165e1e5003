"""A packed copy has the values of the samples bit for bit, or their averages, and reads like any data set."""

import pickle
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

import fracsim.dataset
from fracsim import sample
from fracsim.dataset.__main__ import main
from fracsim.dataset.pack import shrink
from fracsim.records import Array
from fracsim.sample.quantise import LEVELS
from tests.command import environment, python

from . import tiny

blosc2 = pytest.importorskip("blosc2")
COUNT = 5
EVERYTHING = ("rgb", "alpha", "flow", "strain", "stress", "damage")


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.make(tmp_path_factory.mktemp("data"), COUNT)


@pytest.fixture(scope="module")
def packed(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("packed")
    assert pack(clips, out) == 0
    return out


@pytest.fixture(scope="module")
def half(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("half")
    assert pack(clips, out, "--size", str(tiny.WIDTH // 2), "--processes", "2") == 0
    return out


def pack(clips: Path, out: Path, *options: str) -> int:
    return main(["export", str(clips), "--to", "pack", str(out), *options])


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def bits(values: Array) -> Array:
    return values.view(np.uint8)


@pytest.mark.parametrize("what", EVERYTHING)
def test_values_are_those_of_the_samples(clips: Path, packed: Path, what: str) -> None:
    originals, copies = fracsim.dataset.open(clips), fracsim.dataset.open(packed)
    assert len(copies) == COUNT
    for original, copy in zip(originals, copies, strict=True):
        for start, stop in ((0, None), (2, 5), (tiny.FRAMES - 1, tiny.FRAMES)):
            one, other = original.read(what, start, stop), copy.read(what, start, stop)
            assert one.dtype == other.dtype
            assert (bits(one) == bits(other)).all()


def test_the_rest_is_that_of_the_samples(clips: Path, packed: Path) -> None:
    for original, copy in zip(fracsim.dataset.open(clips), fracsim.dataset.open(packed), strict=True):
        changed = {name for name, value in original.row.items() if copy.row[name] != value}
        assert changed <= {"bytes", "sha256", "written", *(f"{what}_file_name" for what in EVERYTHING)}
        assert copy.sample.scene == original.sample.scene
        for mine, theirs in zip(copy.sample.tracks, original.sample.tracks, strict=True):
            assert (mine == theirs).all()
        assert (copy.sample.history["t"] == original.sample.history["t"]).all()
        assert sample.verify(copy.sample.path) == []


def test_blosc2_alone_reads_them(clips: Path, packed: Path) -> None:
    """One chunk a frame, and the file says how to decode it."""
    clip = fracsim.dataset.open(clips)[0]
    stored = blosc2.open(str(packed / clip.row["id"] / "maps" / "flow.b2nd"), mode="r")
    assert stored.shape == (tiny.FRAMES, 2, tiny.HEIGHT, tiny.WIDTH)
    assert stored.chunks == (1, *stored.shape[1:])
    lo, hi = np.moveaxis(np.array(stored.schunk.vlmeta["ranges"])[2:4], -1, 0)[..., None, None]
    values = lo + stored[2:4] / LEVELS * (hi - lo)
    np.testing.assert_allclose(np.moveaxis(values, 1, -1), clip.read("flow", 2, 4), rtol=1e-6, atol=1e-6)
    assert stored.schunk.vlmeta["unit"] == "m/s"


def test_wild_pixels_are_exact_and_so_are_their_averages(clips: Path, packed: Path, half: Path) -> None:
    """The average over 2 x 2 pixels of 1e9 Pa and of three of at most 7 kPa."""
    frame, _, row, column, value = tiny.WILD
    (wild,) = fracsim.dataset.open(clips).filter(break_frame=3)
    whole, small = (fracsim.dataset.open(folder).filter(id=wild.row["id"])[0] for folder in (packed, half))
    assert whole.read("stress", frame, frame + 1)[0, row, column, 0] == value
    stored = blosc2.open(str(whole.sample.path / "maps" / "stress.b2nd"), mode="r")
    assert stored.schunk.vlmeta["outliers"] == [list(tiny.WILD)]
    averaged = small.read("stress", frame, frame + 1)[0, ..., 0]
    np.testing.assert_allclose(averaged[row // 2, column // 2], value / 4, rtol=1e-4)
    exact = shrink(wild.read("stress", frame, frame + 1)[0], *averaged.shape)[..., 0]
    np.testing.assert_allclose(averaged, exact, rtol=1e-6, atol=0.51 * 7e3 / LEVELS)


def first_sum(folder: str, index: int) -> float:
    return float(fracsim.dataset.open(folder)[index].read("stress", 1, 3).sum())


def test_it_can_be_sent_to_other_processes(packed: Path) -> None:
    copies = fracsim.dataset.open(packed)
    expected = [float(clip.read("stress", 1, 3).sum()) for clip in copies]
    again = pickle.loads(pickle.dumps(copies))
    assert [float(clip.read("stress", 1, 3).sum()) for clip in again] == expected
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        assert list(pool.map(first_sum, [str(packed)] * COUNT, range(COUNT))) == expected


def test_reading_needs_no_taichi(packed: Path) -> None:
    told = python(f"import sys, fracsim.dataset as d; print(d.open({str(packed)!r})[0].read('rgb').shape)\n"
                  "print({'taichi', 'torch'} & set(sys.modules))")  # fmt: skip
    assert told.splitlines() == [str((tiny.FRAMES, tiny.HEIGHT, tiny.WIDTH, 3)), "set()"]


def test_the_quotient_of_averages_is_the_quantity(half: Path) -> None:
    """A map holds quantity x coverage: averaging both keeps a constant quantity, whatever the coverage is."""
    alpha = np.random.default_rng(0).random((48, 32)).astype(np.float32)
    small = shrink(7e3 * alpha, 24, 16) / shrink(alpha, 24, 16)
    np.testing.assert_allclose(small, 7e3, rtol=1e-6)


def test_reduced_clips_hold_averages(clips: Path, half: Path) -> None:
    """Of blocks of 2 x 2, to half a level of their codes and the rounding of float32."""
    for original, copy in zip(fracsim.dataset.open(clips), fracsim.dataset.open(half), strict=True):
        assert copy.sample.meta["size"] == [16, 24] == [copy.row["width"], copy.row["height"]]
        for what in EVERYTHING:
            big = original.read(what).astype(np.float64)
            blocks = big.reshape(tiny.FRAMES, 24, 2, 16, 2, *big.shape[3:]).mean(axis=(2, 4))
            small = copy.read(what)
            step = {"rgb": 1.0, "alpha": 1 / LEVELS}.get(what, np.ptp(blocks) / (LEVELS - 1))
            assert np.abs(small - blocks).max() <= 0.5 * step + 2**-23 * blocks.max()
            assert what == "rgb" or (small[blocks == 0] == 0).all()
        old, new = original.sample.meta["view"], copy.sample.meta["view"]
        assert [new[name] * 2 for name in ("fx", "fy", "cx", "cy")] == [old[name] for name in ("fx", "fy", "cx", "cy")]
        assert (copy.sample.tracks.xy * 2 == original.sample.tracks.xy).all()
        assert sample.verify(copy.sample.path) == []


@pytest.mark.parametrize(("height", "width"), [(48, 32), (24, 16), (36, 24), (7, 5)])
def test_averages_keep_the_mean_and_zero(height: int, width: int) -> None:
    """Every old pixel counts by its area: the mean stays; at the old size nothing changes."""
    picture = np.random.default_rng(1).random((48, 32, 3)).astype(np.float32)
    small = shrink(picture, height, width)
    assert small.shape == (height, width, 3)
    np.testing.assert_allclose(*(p.mean(axis=(0, 1), dtype=float) for p in (small, picture)), rtol=1e-6)
    np.testing.assert_allclose(shrink(np.ones((48, 32)), height, width), 1, rtol=1e-6)
    assert (shrink(np.zeros((48, 32)), height, width) == 0).all()
    assert (height, width) != (48, 32) or (small == picture).all()


KILLED = """
import os, pathlib, signal, sys
from fracsim.dataset.__main__ import main
rename, left = pathlib.Path.rename, int(sys.argv[1])
def counted(old, new):
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return rename(old, new)
pathlib.Path.rename = counted
main(sys.argv[2:])
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_killed_and_continued_gives_the_same_bytes(clips: Path, packed: Path, tmp_path: Path) -> None:
    words = ["export", str(clips), "--to", "pack", str(tmp_path)]
    killed = subprocess.run([sys.executable, "-c", KILLED, "3", *words], env=environment())
    assert killed.returncode == -signal.SIGKILL
    assert pack(clips, tmp_path, "--verify") == 1
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*/meta.json") if "partial" not in path.parent.name}
    assert len(kept) == 2
    assert pack(clips, tmp_path) == 0
    assert pack(clips, tmp_path, "--verify") == 0
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    (packed / "metadata.parquet").unlink(missing_ok=True)
    assert contents(tmp_path) == contents(packed)


def test_verify_finds_what_is_wrong(
    clips: Path, packed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    shutil.copytree(packed, out)
    first, second, *_ = sorted(path.parent for path in out.glob("*/meta.json"))
    shutil.rmtree(first)
    data = bytearray((second / "rgb.b2nd").read_bytes())
    data[len(data) // 2] ^= 1
    (second / "rgb.b2nd").write_bytes(data)
    assert pack(clips, out, "--verify") == 1
    missing, changed = capsys.readouterr().out.splitlines()
    assert missing.startswith(f"{first.name}: ")
    assert "is not a sample" in missing
    assert changed == f"{second.name}: rgb.b2nd has changed"


def test_a_sample_that_changed_is_packed_again(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grown, out = tmp_path / "grown", tmp_path / "out"
    shutil.copytree(clips, grown)
    assert pack(grown, out, "--only", "damage") == 0
    (scene,) = tiny.scenes(grown, 1)
    scene.output.overwrite = True
    path = tiny.record(scene, 77, broken=1)
    assert pack(grown, out, "--verify") == 1
    assert pack(grown, out, "--only", "damage") == 0
    assert f"1 clips written, {COUNT - 1} were there" in capsys.readouterr().out
    again = sample.read(out / path.name)
    assert (again.read("damage") == sample.read(path).read("damage")).all()
    with pytest.raises(ValueError, match="stress was not recorded"):
        again.read("stress")


def test_cut_short(packed: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(next(path.parent for path in packed.glob("*/meta.json")), copy)
    file = copy / "maps" / "damage.b2nd"
    file.write_bytes(file.read_bytes()[:2000])
    with pytest.raises(ValueError, match="missing or cut short"):
        sample.read(copy)
    file.write_bytes(bytes(file.stat().st_size))
    meta = sample.read(packed / next(packed.glob("*/meta.json")).parent.name).meta
    file.write_bytes(bytes(meta["files"]["maps/damage.b2nd"]["bytes"]))
    with pytest.raises(ValueError, match=r"damage\.b2nd is damaged"):
        sample.read(copy).read("damage")


@pytest.mark.parametrize(("size", "complaint"), [("31", "does not fit clip"), ("64", "does not fit clip")])
def test_sizes_that_do_not_fit(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], size: str,
                               complaint: str) -> None:  # fmt: skip
    assert pack(clips, tmp_path, "--size", size) == 2
    assert complaint in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_without_blosc2(clips: Path, packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                        capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    """The table of a packed copy is read all the same."""
    monkeypatch.setitem(sys.modules, "blosc2", None)
    assert pack(clips, tmp_path) == 2
    assert "pip install 'fracsim[formats]'" in capsys.readouterr().err
    copies = fracsim.dataset.open(packed)
    assert len(copies) == COUNT
    with pytest.raises(ValueError, match="packed samples need blosc2"):
        copies[0].read("rgb", 0, 1)


def test_the_data_set_itself_is_no_place_for_a_copy(clips: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert pack(clips, clips) == 2
    assert "is the data set itself" in capsys.readouterr().err
