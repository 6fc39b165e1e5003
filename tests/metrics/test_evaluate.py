"""`python -m fracgen.evaluate`: what is paired, what is observed and when, what is written, how it goes on."""

import csv
import json
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from torch import Tensor

from fracgen import evaluate as command
from fracgen.config.model import Vae
from fracgen.evaluation import coded, job, load, observe, pairing
from fracgen.evaluation.clip import TRACKS, LackingError
from fracsim.sample import read
from tests.command import environment
from tests.metrics import folders
from tests.metrics.folders import config, generated, grey, results, truth


def test_videos_are_paired_by_their_names_and_their_results_are_means(films: Path) -> None:
    done = job.run(config(films))
    assert results(done) == pytest.approx({"difference": 70 / 3 / 255, "largest": 40 / 255})
    rows = {row["clip"]: row for row in csv.DictReader((films / "out/per_clip.csv").open())}
    assert {name: float(row["brightness.difference"]) * 255 for name, row in rows.items()} == pytest.approx(
        {"a": 10, "b": 20, "c": 40}
    )
    assert json.loads((films / "out/metrics.json").read_text())["metrics"]["brightness"]["n"] == 3
    assert "| brightness.difference ↓ | 0.0915" in (films / "out/table.md").read_text()
    assert r"brightness.difference $\downarrow$ & 0.0915" in (films / "out/table.tex").read_text()
    assert not list((films / "out").glob(".*.part"))


def test_videos_of_other_kinds_and_in_subfolders_are_read(tmp_path: Path) -> None:
    """A GIF of four greys, whose frames last 30 and 200 ms: each frame counts once."""
    pictures = [Image.fromarray(frame) for frame in (grey(60 * k, 1)[0] for k in range(4))]
    for side in ("pred", "gt"):
        (tmp_path / side / "set").mkdir(parents=True)
        pictures[0].save(tmp_path / side / "set" / "x.gif", save_all=True, append_images=pictures[1:],
                         duration=[30, 200, 30, 200])  # fmt: skip
    cfg = config(tmp_path)
    (couple,) = pairing.pairs(cfg).couples
    assert couple.name == "set/x"
    assert load.pair(couple, cfg).pred.rgb[:, 0, 0, 0].tolist() == [0, 60, 120, 180]
    assert results(job.run(cfg))["difference"] == 0


def test_a_generated_sample_knows_its_true_clip_and_its_groups(tmp_path: Path) -> None:
    here = [truth(tmp_path / "gt", name, speed=1 + k) for k, name in enumerate(("duck", "bread"))]
    for path in here:
        generated(tmp_path / "pred", path)
    truth(tmp_path / "gt", "star")
    done = job.run(config(tmp_path, by=["object", "class"]))
    entry = done.document["metrics"]["brightness"]
    assert (entry["n"], done.document["alone"]) == (2, 1)
    assert {name: one["n"] for name, one in entry["by"]["object"].items()} == {"bread": 1, "duck": 1}
    assert list(entry["by"]["class"]) == ["high_stretch", "low_stretch"]
    assert done.document["run"]["stage"] == 3


def test_a_simulation_of_another_quality_is_paired_by_its_scene(tmp_path: Path) -> None:
    """Half the size is another id, but the same pull; another speed is another pull."""
    truth(tmp_path / "pred", factor=1)
    there = truth(tmp_path / "gt", factor=2)
    truth(tmp_path / "gt", factor=2, speed=3.0)
    (couple,) = pairing.pairs(config(tmp_path)).couples
    assert couple.gt is not None
    assert couple.gt.name == there.name != couple.name


def test_a_csv_file_names_pairs_and_groups(films: Path) -> None:
    lines = (
        "pred,gt,object,speed",
        "pred/a.mkv,gt/b.mkv,ring,1.5",
        "pred/b.mkv,gt/a.mkv,star,2",
        "pred/no.mkv,gt/a.mkv",
    )
    (films / "pairs.csv").write_text("\n".join(lines))
    cfg = config(films, pred=str(films / "pairs.csv"), gt="", by=["object", "speed"])
    done = job.run(cfg)
    assert {name: one["results"]["difference"]["value"] * 255
            for name, one in done.document["metrics"]["brightness"]["by"]["object"].items()} == pytest.approx(
        {"ring": 10, "star": 20})  # fmt: skip
    assert list(done.document["metrics"]["brightness"]["by"]["speed"]) == ["1.5", "2"]
    assert [fault.clip for fault in done.faults] == ["pred/no.mkv"]


def test_without_true_clips_only_what_needs_none_is_computed(films: Path) -> None:
    done = job.run(config(films, gt=""))
    assert done.document["metrics"] == {}
    assert "has no true clip" in done.document["missing"]["brightness"]


def test_true_clips_are_averaged_and_cut_as_the_training_did(tmp_path: Path) -> None:
    """Of 6 frames of 96 x 64 px the training used 3, evenly spread, of 48 x 32 px; tracks shrink along."""
    there = read(truth(tmp_path / "gt", factor=2))
    generated(tmp_path / "pred", there.path, frames=3, encoding={"frame_select": "linspace", "percentile": 90.0})
    cfg = config(tmp_path)
    (couple,) = pairing.pairs(cfg).couples
    gt = load.pair(couple, cfg).true
    means = there.rgb[[0, 2, 5]].reshape(3, 32, 2, 48, 2, 3).mean(axis=(2, 4))
    assert np.abs(gt.rgb - means).max() <= 0.5  # whole numbers
    assert gt.alpha.shape == (3, 32, 48)
    stress = there.maps["stress"][[0, 2, 5]].reshape(3, 32, 2, 48, 2, 1).mean(axis=(2, 4))
    scale = np.percentile(stress[stress > 0], 90)
    assert gt.scales["stress"] == pytest.approx(scale)
    assert np.allclose(gt.map("stress"), np.clip(stress / scale, 0, 1), atol=1e-6)
    assert gt.map("flow").shape == (3, 32, 48, 3)
    assert np.allclose(gt.get(TRACKS).xy[:, 0], [[1, 2], [3, 4], [6, 7]])
    assert gt.fps == pytest.approx(40)  # five steps of 10 ms in two


def test_maps_of_a_generated_sample_have_no_scale_but_damage(tmp_path: Path) -> None:
    generated(tmp_path / "pred", truth(tmp_path / "gt"))
    cfg = config(tmp_path)
    pred = load.pair(pairing.pairs(cfg).couples[0], cfg).pred
    assert dict(pred.scales) == {"damage": 1.0}
    assert pred.map("stress").shape == (6, 32, 48, 1)


def test_only_streams_that_are_asked_for_are_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    generated(tmp_path / "pred", truth(tmp_path / "gt"))
    read_, asked = load._Opened.raw, []
    monkeypatch.setattr(load._Opened, "raw", lambda self, s, n: (asked.append(s), read_(self, s, n))[1])
    job.run(config(tmp_path))
    assert asked == ["rgb", "rgb"]
    job.run(config(tmp_path, metric={"brightness": {"map": "damage"}}))
    assert asked[2:] == ["damage", "damage"]


def test_a_clip_that_stands_still_repeats_its_first_frame(tmp_path: Path) -> None:
    generated(tmp_path / "pred", truth(tmp_path / "gt"))
    cfg = config(tmp_path, controls=["static"])
    (still,) = job.controls.couples(pairing.pairs(cfg), cfg)["static"]
    pair = load.pair(still, cfg)
    for stream in ("rgb", "damage", "flow", "alpha"):
        assert np.array_equal(pair.pred.get(stream), np.repeat(pair.true.get(stream)[:1], 6, axis=0))
    assert np.array_equal(pair.pred.get(TRACKS).xy, np.repeat(pair.true.get(TRACKS).xy[:1], 6, axis=0))


def test_controls_stand_beside_the_results(tmp_path: Path) -> None:
    """The true clip against itself; a twin, the same scene with another seed; the frames and size of the predicted."""
    there = truth(tmp_path / "gt", seed=0, factor=2, frames=8)
    truth(tmp_path / "gt", seed=1, factor=2, frames=8)
    generated(tmp_path / "pred", there)
    done = job.run(config(tmp_path, controls=["truth", "static", "twins"]))
    found = {name: entry["metrics"]["brightness"]["results"]["difference"]["value"]
             for name, entry in done.document["controls"].items()}  # fmt: skip
    assert found["truth"] == 0
    assert found["static"] > 0
    assert found["twins"] > 0
    assert "column twins: the same scenes with another seed, 1 clip(s)" in done.table


def test_the_command_prints_the_table_and_where_it_lies(
    films: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["evaluate", f"pred={films / 'pred'}", f"gt={films / 'gt'}", f"outside=[{folders.METRIC}]", "controls=[]"]
    monkeypatch.setattr(sys, "argv", [*asked, "plots=false", "+metric.brightness.gain=2", "resamples=10"])
    command.main()
    lines = capsys.readouterr().out.strip().splitlines()
    assert lines[0] == "| result | all clips [95 %] | n | undefined |"
    assert lines[-1] == str(films / "pred" / "evaluation")
    document = json.loads((films / "pred" / "evaluation" / "metrics.json").read_text())
    assert document["metrics"]["brightness"]["about"] == {"gain": 2.0}


def test_help_and_errors_need_no_torch() -> None:
    code = """
import sys
from fracgen import evaluate, tables
evaluate.EVALUATE.compose("seed=3")
print("torch" in sys.modules)"""
    done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True)
    assert done.stdout == "False\n", done.stderr


def test_pictures_and_a_run_of_wandb_mirror_what_is_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_SILENT", "true")
    monkeypatch.delenv("WANDB_API_KEY", raising=False)
    generated(tmp_path / "pred", truth(tmp_path / "gt"))
    job.run(config(tmp_path, plots=True, logger="wandb"))
    assert (tmp_path / "out/by_object.png").stat().st_size > 1000
    assert list((tmp_path / "out/wandb").glob("offline-run-*/*.wandb"))
    assert (tmp_path / "out/per_clip.csv").is_file()


def test_needs_are_checked_before_anything_is_decoded(films: Path) -> None:
    couple = pairing.pairs(config(films)).couples[0]
    with pytest.raises(LackingError, match="a has no damage; it has rgb"):
        observe._check(load.pair(couple, replace(config(films))).pred, ("rgb", "damage"))


class Halving:
    """Stands in for the VAE: what comes back is half as bright."""

    identity = "halving"

    def encode(self, video: Tensor) -> Tensor:
        assert video.shape == (1, 3, 5, 32, 48)
        return video

    def decode(self, latent: Tensor) -> Tensor:
        return latent / 2


def test_the_true_clip_through_the_vae_is_a_ceiling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    generated(tmp_path / "pred", truth(tmp_path / "gt", frames=5), frames=5)
    cfg = config(tmp_path, controls=["vae"], vae=Vae(path="vae.safetensors"))
    monkeypatch.setitem(coded._loaded, repr(asdict(cfg.vae)), Halving())  # type: ignore[arg-type]
    found = pairing.pairs(cfg)
    pair = load.pair(job.controls.couples(found, cfg)["vae"][0], cfg)
    assert np.abs(pair.pred.rgb - pair.true.rgb / 2).max() <= 0.5
    assert np.allclose(pair.pred.map("flow"), pair.true.map("flow") / 2)
    assert np.allclose(pair.pred.map("damage"), pair.true.map("damage") / 2)
    assert pair.pred.map("damage").shape == (5, 32, 48, 1)
    assert not pair.pred.has(TRACKS)
    done = job.run(cfg)
    assert done.document["controls"]["vae"]["metrics"]["brightness"]["results"]["difference"]["value"] > 0.2
    assert job.controls.couples(found, replace(cfg, vae=Vae())) == {}
    with pytest.raises(ValueError, match="nowhere"):
        job.run(replace(cfg, vae=Vae(path="nowhere")))
