"""Metrics of clips of the validation: sampled and decoded once, merged over processes, logged and written."""

import csv
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from fracgen import data, vae
from fracgen.layout import STREAMS
from fracgen.train import TRAIN
from fracgen.training import decoded, panel, scores, stages
from fracgen.training.runs import Run
from tests.gen import grey
from tests.gen.trainings import cache, config, curves

GREY = grey.__file__
ON = ("vae=tiny", "measure.clips=3", f"measure.outside=[{GREY}]", "metric=[]", "logger.video_steps=1")
"""Three clips measured by one metric."""
SHORT = ("init_from=none", *(f"stages.stage{k}.steps=2" for k in (1, 2, 3)))


@pytest.fixture(scope="module", name="latents")
def latents_fixture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache that says it was made by the random tiny VAE; its clips of the validation are of bread and star."""
    about = {"vae": vae.identity_of(TRAIN.compose("vae=tiny").vae)}
    return cache(tmp_path_factory.mktemp("latents"), about=about)


def train(folder: Path, latents: Path, *more: str) -> Run:
    (run,) = stages.run(config(folder, latents, *SHORT, *ON, *more))
    return run


def table(run: Run, step: int = 2) -> list[dict[str, str]]:
    with (run.folder / panel.FOLDER / f"step-{step:06}" / scores.TABLE).open(newline="") as file:
        return list(csv.DictReader(file))


def module_in(folder: Path, text: str) -> Path:
    """A metric that is `grey` but for some of its text."""
    path = folder / "other.py"
    path.write_text(Path(GREY).read_text() + text)
    return path


def test_results_are_logged_over_all_clips_and_by_object_with_their_counts(latents: Path, tmp_path: Path) -> None:
    """Clips 2, 6 and 10 are of bread, 3, 7 and 11 of star; of the first three, 2, 3, 6, one has an odd name."""
    run = train(tmp_path, latents)
    row, clips = curves(run.folder)[2], {line["id"]: line for line in table(run)}
    assert list(clips) == ["clip0002", "clip0003", "clip0006"]
    values = {name: float(line["grey"]) for name, line in clips.items()}
    assert row["val/grey"] == pytest.approx(np.mean(list(values.values())), rel=1e-6)
    assert row["val/star/grey"] == pytest.approx(values["clip0003"], rel=1e-6)
    assert row["val/bread/grey"] == pytest.approx((values["clip0002"] + values["clip0006"]) / 2, rel=1e-6)
    assert (row["val/count/clips/grey"], row["val/count/undefined/grey_true"]) == (3, 1)
    assert "val/count/undefined/grey" not in row
    assert "val/star/grey_true" not in row, "undefined for its only clip"
    assert "val/low_stretch/grey" not in row, "the only class, so that it is the whole"
    assert clips["clip0003"]["grey_true"] == ""
    assert (clips["clip0003"]["object"], float(clips["clip0003"]["E"])) == ("star", 6e3)


def test_truth_is_what_the_vae_decodes_of_the_cache_and_maps_are_grey_or_coloured(latents: Path) -> None:
    clips, decoder = data.open(latents), vae.load(TRAIN.compose("vae=tiny").vae)
    batch = data.collate([clips[2]])
    pair = decoded.pair(decoder, batch, batch.latents, clips.rows[2], clips.about)
    video = decoder.decode(batch.latents["damage"].float())[0]
    np.testing.assert_allclose(pair.true.map("damage")[..., 0], video.mean(dim=0), atol=1e-6)
    assert pair.true.map("flow").shape == (5, 16, 16, 3)
    assert pair.true.rgb.shape == (pair.true.frames, pair.true.height, pair.true.width, 3) == (5, 16, 16, 3)
    assert pair.true.rgb.dtype == np.uint8
    assert np.array_equal(pair.pred.rgb, pair.true.rgb)
    assert pair.groups == {"object": "bread", "class": "low_stretch", "axis": 0.0}
    assert (pair.true.scales["stress"], pair.pred.scales) == (1.0, {})


def test_each_clip_is_sampled_once_and_only_what_is_looked_at_is_decoded(
    latents: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stage 3: of clip 2, which is shown, all ten streams and the force; of clip 3 predicted colour; of 6 both."""
    calls: Counter[str] = Counter()

    def counting(name: str, function: Any) -> Any:
        def called(*arguments: Any) -> Any:
            calls[name] += 1
            return function(*arguments)

        return called

    monkeypatch.setattr(panel, "predict", counting("sampled", panel.predict))
    monkeypatch.setattr(vae.FrozenVae, "decode", counting("decoded", vae.FrozenVae.decode))
    run = train(tmp_path, latents, "stage=3", "logger.videos=1")
    assert calls == {"sampled": 3, "decoded": 2 * len(STREAMS) + 1 + 1 + 2}
    assert [file.stem for file in (run.folder / panel.FOLDER).rglob("*.mp4")] == ["clip0002"]


def test_no_vae_is_loaded_where_nothing_is_wanted(
    latents: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(vae, "load", lambda cfg: pytest.fail("the VAE was loaded"))
    for k, none in enumerate(("measure.clips=0", "measure.outside=[]", "trainer.val_steps=0")):
        assert train(tmp_path / str(k), latents, none).finished


def test_metrics_are_measured_at_every_nth_validation_and_the_last_and_are_no_part_of_a_checkpoint(
    latents: Path, tmp_path: Path
) -> None:
    run = train(tmp_path, latents, "stages.stage1.steps=5", "trainer.val_steps=1", "measure.every_n_val=2")
    rows = curves(run.folder)
    assert [step for step, row in rows.items() if "val/grey" in row] == [2, 4, 5]
    assert all("val/loss/total" in row for row in rows.values())
    content = torch.load(run.checkpoint, weights_only=False)
    assert not any("grey" in str(key) for part in content.values() if isinstance(part, dict) for key in part)


def test_what_measures_does_not_change_what_is_learned(latents: Path, tmp_path: Path) -> None:
    """The losses and the name of the run are those without metrics, bit for bit."""
    run, other = train(tmp_path / "a", latents), train(tmp_path / "b", latents, "measure.clips=0")
    assert run.folder.name == other.folder.name
    rows, others = curves(run.folder), curves(other.folder)
    for step, row in others.items():
        assert {name: rows[step][name] for name in row} == row


def test_nothing_happens_while_lightning_checks_its_sanity(latents: Path, tmp_path: Path) -> None:
    cfg = config(tmp_path, latents, *SHORT, *ON)
    stage = stages.StageData(cfg, ["rgb"])
    callback = panel.build(cfg, stage, tmp_path)
    assert callback is not None
    module = stages.Module(cfg, cfg.stages.stage1, stages.network.build(cfg, ("rgb",)), 2)
    trainer: Any = SimpleNamespace(sanity_checking=True, global_step=0, max_steps=2)
    callback.on_validation_epoch_end(trainer, module)
    assert not (tmp_path / panel.FOLDER).exists()


def test_a_metric_without_its_maps_or_its_weights_is_left_out_and_said_once(
    latents: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mapped = module_in(tmp_path, '\nGrey.needs = ("stress",)\n')
    run = train(tmp_path / "a", latents, f"measure.outside=[{GREY},{mapped}]")
    told = "no other in the validation: this stage has no stress"
    assert capsys.readouterr().err.count(told) == 1
    assert "val/count/clips/grey" in curves(run.folder)[2]
    weightless = module_in(tmp_path, "\nfrom fracgen.evaluation.weights import MissingWeightsError\n"
                           "def build(settings):\n    raise MissingWeightsError('I3D was not found')\n")  # fmt: skip
    run = train(tmp_path / "b", latents, f"measure.outside=[{GREY},{weightless}]")
    assert capsys.readouterr().err.count("no other in the validation: I3D was not found") == 1
    assert "val/count/clips/grey" in curves(run.folder)[2]


def test_a_clip_that_cannot_be_observed_is_said_once_and_the_training_goes_on(
    latents: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picky = module_in(tmp_path, "\nold = Grey.observe\ndef observe(self, pair):\n"
                      "    if pair.groups['object'] == 'bread':\n        raise ValueError('no bread')\n"
                      "    return old(self, pair)\nGrey.observe = observe\n")  # fmt: skip
    run = train(tmp_path, latents, f"measure.outside=[{picky}]")
    assert capsys.readouterr().err.count("other is not measured of clip0002: no bread") == 1
    assert curves(run.folder)[2]["val/count/clips/other"] == 1
    assert [line["grey"] == "" for line in table(run)] == [True, False, True]


def test_fields_of_metrics_are_set_by_name_and_bad_ones_refused(latents: Path, tmp_path: Path) -> None:
    one, three = (train(tmp_path / str(k), latents, f"+metric.grey.times={k}") for k in (1, 3))
    values = [curves(run.folder)[2]["val/grey"] for run in (one, three)]
    assert values[1] == pytest.approx(3 * values[0], rel=1e-6)
    with pytest.raises(ValueError, match=r"metric.grey.times=-1 is not allowed"):
        train(tmp_path, latents, "+metric.grey.times=-1")
    with pytest.raises(ValueError, match=r"metric.grey.tims=1 is not a field"):
        train(tmp_path, latents, "+metric.grey.tims=1")
    with pytest.raises(ValueError, match=r"measure.outside=gray.py is not a file"):
        train(tmp_path, latents, "measure.outside=[gray.py]")


def test_processes_that_share_a_clip_sample_the_same_and_others_the_rest() -> None:
    assert [panel.share([5, 6, 7], rank, 2, 1) for rank in range(2)] == [[5, 7], [6]]
    assert [panel.share([5, 6, 7], rank, 4, 2) for rank in range(4)] == [[5, 7], [5, 7], [6], [6]]


def test_another_vae_than_that_of_the_cache_is_only_refused_where_it_was_given(
    latents: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With videos, which are asked for, and for a VAE with a path; random weights that do not fit are said."""
    assert train(tmp_path / "a", latents, "vae.seed=1").finished
    told = "no metrics of the validation: vae.path is not set (measure.clips=0 silences this)"
    assert capsys.readouterr().err.count(told) == 1
    vae.build(TRAIN.compose("vae=tiny", "vae.seed=1").vae).save_pretrained(tmp_path / "vae")
    with pytest.raises(ValueError, match=r"vae.path=.* made by \w+: give that VAE, or set measure.clips=0"):
        train(tmp_path / "b", latents, f"vae.path={tmp_path / 'vae'}")
