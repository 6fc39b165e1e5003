"""`verify` finds everything that is wrong with a data set, and `retry` mends what can be made again."""

import json
import shutil
from dataclasses import asdict
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from fracsim import compose, sample
from fracsim.dataset import index
from fracsim.dataset.__main__ import main
from fracsim.dataset.retry import retry
from fracsim.dataset.verify import Finding, check
from fracsim.scene.vocab import Scene

from .conftest import small


def wrong(folder: Path, *planned: str) -> list[Finding]:
    """All findings but suspect numbers."""
    return [finding for finding in check(folder, planned) if finding.kind != "suspect"]


def ids(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir() if p.is_dir())


def flip(path: Path) -> None:
    """Change one byte in the middle of a file."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def attempt(folder: Path, name: str, status: str, reason: str = "") -> None:
    """Add an attempt to the journal of the sweep."""
    with (folder / "sweep.jsonl").open("a") as file:
        file.write(json.dumps({"id": name, "status": status, "reason": reason}) + "\n")


def fail(folder: Path, scene: Scene, name: str) -> Path:
    """Write the scene of a failed draw below the reason."""
    path = folder / "failures" / f"{name}.yaml"
    path.parent.mkdir(exist_ok=True)
    path.write_text("# disk full\n" + OmegaConf.to_yaml(asdict(scene)))
    return path


def test_a_sound_data_set_has_suspect_clips_at_most(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With and without a table."""
    assert main(["verify", str(copy)]) == 0
    index.build(copy)
    assert main(["verify", str(copy)]) == 0
    (suspect,) = (row for row in index.rows(copy) if row["status"] == "suspect")
    assert capsys.readouterr().out == 2 * f"suspect    {suspect['id']}  {suspect['reason']}\n1 suspect\n"


def test_files_that_are_not_as_they_were_written(copy: Path) -> None:
    one, two, three, four = ids(copy)
    flip(copy / one / "alpha.mkv")
    (copy / two / "tracks.npz").unlink()
    (copy / three / "meta.json").unlink()
    (copy / four / "meta.json").write_text("{")
    assert wrong(copy) == [
        Finding("broken", one, "alpha.mkv has changed"),
        Finding("broken", two, "tracks.npz is missing"),
        *(Finding("broken", name, sample.verify(copy / name)[0]) for name in (three, four)),
    ]


def test_what_was_planned_tried_or_finished_and_is_not_there(copy: Path) -> None:
    """By the journal, by failures and by the ids given; the last attempt counts, a line cut off does not."""
    one, *_ = ids(copy)
    attempt(copy, one, "failed", "first")
    attempt(copy, one, "complete")
    attempt(copy, "b" * 12, "complete")
    attempt(copy, "a" * 12, "complete")
    attempt(copy, "a" * 12, "failed", "field v is not finite")
    with (copy / "sweep.jsonl").open("a") as file:
        file.write('{"id": "ccc')
    fail(copy, compose(), "d" * 12)
    assert wrong(copy, one, "e" * 12) == [
        Finding("missing", "b" * 12, "sweep.jsonl says complete, but there is no such folder"),
        Finding("missing", "e" * 12, "planned, but never tried"),
        Finding("failed", "a" * 12, "field v is not finite"),
        Finding("failed", "d" * 12, f"its scene is failures/{'d' * 12}.yaml"),
    ]


def test_what_was_not_finished(copy: Path) -> None:
    """What has been left behind by a sample that is there can go."""
    one, two, *_ = ids(copy)
    shutil.copytree(copy / one, copy / f"{one}.incomplete")
    (copy / two).rename(copy / f"{two}.partial-123@host")
    meta = json.loads((copy / f"{two}.partial-123@host" / "meta.json").read_text())
    meta |= {"complete": False, "reason": "it is still being written"}
    (copy / f"{two}.partial-123@host" / "meta.json").write_text(json.dumps(meta))
    assert wrong(copy) == [
        Finding("incomplete", f"{one}.incomplete", f"left behind, {one} is there: delete it"),
        Finding("incomplete", f"{two}.partial-123@host", "it is still being written"),
    ]


def test_copies_and_a_table_of_other_samples(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, two, *_ = ids(copy)
    index.build(copy)
    shutil.copytree(copy / one, copy / "zz")
    assert wrong(copy) == [
        Finding("duplicate", "zz", f"has the pictures of {one}"),
        Finding("table", "metadata.parquet", f"is not that of the samples: run python -m fracsim.dataset index {copy}"),
    ]
    shutil.rmtree(copy / "zz")
    shutil.rmtree(copy / two)
    assert [finding.kind for finding in wrong(copy)] == ["table"]
    assert main(["verify", str(copy)]) == 1
    assert capsys.readouterr().out.splitlines()[-1].startswith("1 table")


def test_other_folders_are_left_out(copy: Path) -> None:
    one, *_ = ids(copy)
    for name in ("multirun", "failures", "sheets", ".cache"):
        shutil.copytree(copy / one, copy / name / one)
    assert wrong(copy) == []


def test_one_sample_can_be_checked(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = copy / index.rows(copy)[0]["path"]
    flip(path / "maps" / "damage.mkv")
    assert main(["verify", str(path)]) == 1
    assert f"broken     {path.name}  maps/damage.mkv has changed" in capsys.readouterr().out


def test_ids_may_be_given_in_a_file(copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "ids.txt").write_text("\n".join([*ids(copy), "f" * 12]))
    assert main(["verify", str(copy), "--ids", str(tmp_path / "ids.txt")]) == 1
    assert capsys.readouterr().out.startswith(f"missing    {'f' * 12}  planned, but never tried")


def test_a_folder_without_samples(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(tmp_path)]) == 2
    assert "holds no samples: give a folder that a sweep has written to" in capsys.readouterr().err


def test_failed_and_broken_draws_are_run_again(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Whatever folder the scene was for; what fails again and what cannot be read stays."""
    broken = next(row["path"] for row in index.rows(copy) if row["object"] == "duck")
    flip(copy / broken / "rgb.mkv")
    scene = compose(*small("asset=duck", "loading.speed=3"), "output.folder=elsewhere")
    good = fail(copy, scene, sample.scene_id(scene))
    hopeless = compose(*small())
    hopeless.asset.name = "no_such_object"
    bad, again = (fail(copy, hopeless, name) for name in ("c" * 12, sample.scene_id(hopeless)))
    again.unlink()
    other = fail(copy, scene, "d" * 12)
    other.write_text("speed: 3")
    assert main(["retry", str(copy)]) == 1
    out = capsys.readouterr().out
    assert (copy / sample.scene_id(scene)).is_dir()
    assert not good.exists()
    assert (bad.exists(), again.exists()) == (False, True)  # failures are named by their id
    assert other.exists()
    assert sample.verify(copy / broken) == []
    assert f"failed again  {again.stem}: asset.name=no_such_object" in out
    assert f"failed again  {other.relative_to(copy)}: " in out
    assert "2 succeeded, 2 failed again" in out
    assert {finding.kind for finding in wrong(copy)} == {"failed"}
    assert sample.scene_id(scene) in {row["id"] for row in index.rows(copy)}


def test_a_sample_whose_scene_has_changed_cannot_be_made_again(copy: Path) -> None:
    name = ids(copy)[0]
    path = copy / name / "scene.yaml"
    path.write_text(path.read_text().replace("seed: 0", "seed: 1"))
    done, left = retry(copy)
    assert (done, len(left)) == (0, 1)
    assert "scene.yaml is not that of its sample" in left[0]
    assert "delete the folder" in left[0]
