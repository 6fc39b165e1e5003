"""Three stages: each starts from the weights of the one before; what makes two runs the same, and what refuses one."""

import json
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from safetensors.torch import load_file

from fracgen.data import Place, index
from fracgen.data.sampler import KeyedSampler
from fracgen.model import trained
from fracgen.training import identity, stages
from fracgen.training.runs import Run
from fracgen.training.stream import Stream
from tests.gen.trainings import cache, config, curves, only

SHORT = ("stages.stage1.steps=2", "stages.stage2.steps=2", "stages.stage3.steps=2", "trainer.val_steps=0")


@pytest.fixture(scope="module")
def latents(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cache(tmp_path_factory.mktemp("latents"))


@pytest.fixture(scope="module")
def three(latents: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    """All three stages by one command."""
    return stages.run(config(tmp_path_factory.mktemp("runs"), latents, "stage=all", *SHORT))


@pytest.fixture(scope="module")
def plain(latents: Path) -> str:
    """The id of stage 2 without overrides."""
    return ids(latents, latents)


def folder(three: list[Run]) -> Path:
    return three[0].folder.parent


def ids(folder: Path, latents: Path, *more: str, stage: int = 2) -> str:
    """The id that a stage would have."""
    cfg = config(folder, latents, *SHORT, *more)
    data = stages.StageData(cfg, identity.recipe_of(cfg, stage).streams)
    return stages.wanted_before(cfg, stage + 1, data, "base").id


FILES = {"losses.png", "config.yaml", "last.ckpt", "trained.safetensors", "metrics.csv", "run.json"}


def test_a_finished_run_has_its_files(three: list[Run]) -> None:
    parents = ["", *(str(run.folder) for run in three)]
    for stage, run in enumerate(three, 1):
        assert run.folder.name == f"stage{stage}-{run.id}"
        assert {p.name for p in run.folder.iterdir()} == FILES
        facts = json.loads((run.folder / "run.json").read_text())
        assert (facts["stage"], facts["steps"], facts["parent"]) == (stage, 2, parents[stage - 1])


def test_trained_weights_say_what_they_belong_to(three: list[Run], latents: Path) -> None:
    tensors, about = trained.read(three[2].folder)
    assert {name.partition(".")[0] for name in tensors} == {"transformer", "constitutive"}
    assert {*trained.ABOUT, "cache", "id"} <= set(about)
    assert about["cache"] == index.load(latents).about
    assert about["streams"] == ["rgb", "flow", "strain", "stress", "damage"]
    network = trained.assemble(three[2].folder)
    assert torch.equal(network.proj_out.weight, tensors["transformer.proj_out.weight"])


def test_a_stage_starts_from_the_weights_of_the_one_before_with_a_fresh_optimiser(
    three: list[Run], latents: Path, tmp_path: Path
) -> None:
    """With a learning rate of next to nothing, stage 2 ends with the weights of stage 1; its warm-up begins anew."""
    more = (*SHORT, "stage=2", "stages.stage2.lr=1e-12", f"init_from={three[0].folder}")
    stages.run(config(tmp_path, latents, *more))
    before, after = (load_file(run / "trained.safetensors") for run in (three[0].folder, only(tmp_path, 2)))
    assert before.keys() == after.keys()
    for name, tensor in before.items():
        torch.testing.assert_close(after[name], tensor, rtol=0, atol=1e-10)
    rows = curves(three[1].folder)
    assert [row["lr"] for row in rows.values()] == [5e-4, 1e-3]  # warmup=2, lr=1e-3
    content = torch.load(three[1].checkpoint, weights_only=True)
    assert {int(state["step"]) for state in content["optimizer_states"][0]["state"].values()} == {2}


def test_each_stage_alone_finds_the_run_before_it(
    three: list[Run], latents: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Stage 3 by its own command is the run of stage=all, which is not run again."""
    (run,) = stages.run(config(folder(three), latents, *SHORT, "stage=3"))
    assert run.folder == three[2].folder
    assert f"finished before: {run.folder} (output.overwrite=true repeats it)" in capsys.readouterr().out


def test_a_sweep_of_stage_three_shares_stage_two(three: list[Run], latents: Path) -> None:
    (run,) = stages.run(config(folder(three), latents, *SHORT, "stage=3", "loss.lambda_const=0", "loss.gate=affine"))
    assert run.id != three[2].id
    assert json.loads((run.folder / "run.json").read_text())["parent"] == str(three[1].folder)


def test_a_missing_parent_is_one_error_with_the_ways_out(three: list[Run], latents: Path, tmp_path: Path) -> None:
    with pytest.raises(
        ValueError, match=r"stage 3 starts from a finished run of stage 2.*stage=2.*stage=all.*init_from=none"
    ):
        stages.run(config(tmp_path, latents, *SHORT, "stage=3"))
    with pytest.raises(
        ValueError, match=rf"use another one by init_from={three[1].folder}, where .*loss.shift=1.0 \(there 5.0"
    ):
        stages.run(config(folder(three), latents, *SHORT, "stage=3", "loss.shift=1"))


def test_an_unfinished_parent_is_refused(three: list[Run], latents: Path, tmp_path: Path) -> None:
    cfg = config(tmp_path, latents, *SHORT)
    (first,) = stages.run(cfg)
    (first.folder / "run.json").unlink()
    with pytest.raises(ValueError, match=rf"{first.folder} is none yet"):
        stages.run(replace(cfg, stage=2))


def test_weights_of_another_base_are_refused(three: list[Run], latents: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"belongs to base weights random-0-\w+, but the model has random-1-\w+"):
        stages.run(config(tmp_path, latents, *SHORT, "stage=2", "model.seed=1", f"init_from={three[0].folder}"))


def test_weights_of_another_model_are_refused(three: list[Run], latents: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="belongs to base weights"):
        stages.run(config(tmp_path, latents, *SHORT, "stage=2", "model.layers=2", f"init_from={three[0].folder}"))


def test_a_finished_run_is_repeated_on_request(latents: Path, tmp_path: Path) -> None:
    (run,) = stages.run(config(tmp_path, latents, *SHORT))
    before, weights = os.stat(run.folder / "run.json").st_mtime_ns, load_file(run.folder / "trained.safetensors")
    stages.run(config(tmp_path, latents, *SHORT, "output.overwrite=true"))
    assert os.stat(run.folder / "run.json").st_mtime_ns > before
    again = load_file(run.folder / "trained.safetensors")
    assert all(torch.equal(again[name], weights[name]) for name in weights)


# Identity

SAME = ("name=other", "logger.kind=none", "logger.videos=3", "data.workers=3", "trainer.batch=2", "trainer.devices=2",
        "trainer.checkpointing=full", "trainer.val_steps=1", "trainer.log_steps=3", "trainer.save_steps=2",
        "data.val_limit=1", "loss.lambda_const=0.7", "loss.ramp=3", "stages.stage3.lr=1e-2", "vae=tiny")  # fmt: skip
OTHER = ("seed=1", "loss.shift=1", "loss.map_weights=[1,2,1,1,1]", "trainer.effective_batch=2", "trainer.ema=0.9",
         "stages.stage1.lr=1e-2", "stages.stage2.steps=9", "trainer.weight_decay=0.1", "data.limit=6",
         "conditioning.height=rgb_only", "model.rope=shared", "trainer.clip=0.5")  # fmt: skip


@pytest.mark.parametrize("override", SAME)
def test_what_only_changes_speed_or_a_later_stage_keeps_the_id(override: str, latents: Path, plain: str) -> None:
    assert ids(latents, latents, override) == plain


@pytest.mark.parametrize("override", OTHER)
def test_what_shapes_the_weights_changes_the_id(override: str, latents: Path, plain: str) -> None:
    assert ids(latents, latents, override) != plain


def test_the_weight_of_a_map_does_not_shape_a_stage_without_it(latents: Path, tmp_path: Path) -> None:
    more = "loss.map_weights=[1,2,1,1,1]"
    assert ids(tmp_path, latents, more, stage=1) == ids(tmp_path, latents, stage=1)


def test_a_cache_of_other_latents_changes_the_id_and_one_with_more_test_clips_does_not(
    latents: Path, tmp_path: Path
) -> None:
    there = index.load(latents)
    copy = tmp_path / "copy"
    copy.mkdir()
    for file in latents.iterdir():
        (copy / file.name).symlink_to(file)
    assert ids(tmp_path, copy) == ids(tmp_path, latents)
    (copy / "cache.json").unlink()
    (copy / "cache.json").write_text(json.dumps({**there.about, "vae": "another"}))
    assert ids(tmp_path, copy) != ids(tmp_path, latents)
    more = cache(tmp_path / "more", clips=18)  # the last two clips are to train on
    assert ids(tmp_path, more, "data.limit=8") == ids(tmp_path, latents)


# The order of clips


def test_the_stream_of_a_stage_is_the_order_of_its_epochs_from_any_step_on() -> None:
    """Ten clips in steps of four: three steps an epoch, whose last one is filled up."""
    keyed = KeyedSampler(range(10), seed=0, batch=1, effective_batch=4)
    whole = list(Stream(keyed, 0, 7))
    assert whole == [*keyed.order(0), *keyed.order(1), *keyed.order(2)][:28]
    assert list(Stream(keyed, 5, 7)) == whole[20:]
    assert len(Stream(keyed, 5, 7)) == 8
    assert isinstance(whole[0], Place)


def test_ranks_share_the_stream() -> None:
    ranks = [KeyedSampler(range(10), seed=0, batch=1, effective_batch=4, rank=r, ranks=2) for r in range(2)]
    first, second = (list(Stream(keyed, 1, 4)) for keyed in ranks)
    together = [place for pair in zip(first, second, strict=True) for place in pair]
    assert together == list(Stream(KeyedSampler(range(10), seed=0, batch=1, effective_batch=4), 1, 4))


def test_a_stage_that_does_not_fit_on_the_gpu_is_refused_before_it_begins(latents, tmp_path, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_properties", lambda index: SimpleNamespace(total_memory=2**20))
    about = index.load(latents).about
    with pytest.raises(ValueError, match=r"stage=2 needs .* GiB"):
        stages.check_memory(config(tmp_path, latents, "trainer.accelerator=gpu"), 2, about)
    stages.check_memory(config(tmp_path, latents), 2, about)  # on the CPU, memory is the system's affair
