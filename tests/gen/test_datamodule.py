"""The order of training clips is a function of (seed, epoch, position), and what a training needs is checked first."""

from pathlib import Path
from typing import Any

import pytest
import torch
from lightning import LightningModule, Trainer
from lightning.pytorch.callbacks import ModelCheckpoint
from torch import Tensor
from torch.utils.data import DataLoader

import fracgen.data
from fracgen.config import train as config
from fracgen.config.model import Model
from fracgen.config.train import TrainConfig
from fracgen.data import Batch, DataModule, Place, synthetic
from fracgen.data.cache import LatentCache
from fracgen.data.sampler import KeyedSampler

CLIPS = list(range(10, 17))
"""Seven numbers, so that effective batches of four do not fill an epoch."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve clips, half of them of the split train."""
    return synthetic.write(tmp_path_factory.mktemp("caches") / "latents", clips=12, frames=5, size=16, text_dim=8)


def cfg(folder: Path, data: dict[str, Any] | None = None, model: dict[str, Any] | None = None, **trainer: Any
        ) -> TrainConfig:  # fmt: skip
    return TrainConfig(data=config.Data(**{"folder": str(folder), "workers": 0, **(data or {})}),
                       model=Model(**{"text_dim": 8, "image_dim": 0, **(model or {})}),
                       trainer=config.Trainer(**{"effective_batch": 4, **trainer}))  # fmt: skip


Seen = list[tuple[int, int, int]]


def seen(batches: Any) -> Seen:
    """Number, epoch and place in the effective batch of each clip, in order."""
    return [(int(number), int(epoch), int(slot)) for batch in batches
            for number, epoch, slot in zip(batch.indices, batch.epoch, batch.slot, strict=True)]  # fmt: skip


def steps(places: list[Place], size: int) -> list[set[Place]]:
    return [set(places[k : k + size]) for k in range(0, len(places), size)]


def test_an_order_is_a_function_of_seed_and_epoch() -> None:
    orders = [[place.number for place in KeyedSampler(CLIPS, seed, 1, 7).order(epoch)]
              for seed, epoch in ((0, 0), (0, 0), (0, 1), (1, 0))]  # fmt: skip
    assert orders[0] == orders[1]
    assert orders[0] != orders[2] != orders[3] != orders[0]
    assert all(sorted(order) == CLIPS for order in orders)


def test_an_epoch_is_filled_up_with_its_own_first_clips() -> None:
    sampler = KeyedSampler(CLIPS, 3, 1, 4)
    order = [place.number for place in sampler.order(2)]
    assert (sampler.steps, len(sampler), len(order)) == (2, 8, 8)
    assert order[7] == order[0]
    assert sorted(order[:7]) == CLIPS


def test_the_places_of_a_step_are_all_different() -> None:
    assert [place.slot for place in KeyedSampler(CLIPS, 0, 1, 4).order(0)] == [0, 1, 2, 3, 0, 1, 2, 3]


@pytest.mark.parametrize(("ranks", "batch"), [(2, 1), (2, 2), (4, 1), (1, 4)])
def test_the_steps_of_ranks_together_are_those_of_one_process(ranks: int, batch: int) -> None:
    alone = steps(list(KeyedSampler(CLIPS, 5, 1, 4)), 4)
    each = [steps(list(KeyedSampler(CLIPS, 5, batch, 4, rank, ranks)), 4 // ranks) for rank in range(ranks)]
    assert [set.union(*parts) for parts in zip(*each, strict=True)] == alone
    assert all(len(step) == 4 for step in alone)


def test_epochs_follow_each_other() -> None:
    sampler = KeyedSampler(CLIPS, 0, 1, 4)
    assert [list(sampler) for _ in range(3)] == [sampler.order(epoch) for epoch in range(3)]


def test_a_training_goes_on_in_the_middle_of_an_epoch() -> None:
    sampler = KeyedSampler(CLIPS, 0, 1, 4)
    sampler.start(1, steps=1)
    assert list(sampler) == sampler.order(1)[4:]
    assert list(sampler) == sampler.order(2)
    assert len(sampler) == 8


def test_an_effective_batch_that_cannot_be_dealt_is_refused() -> None:
    with pytest.raises(ValueError, match=r"effective_batch=4 must be a multiple of .* = 3 x 2, .*: set it to 6\."):
        KeyedSampler(CLIPS, 0, 3, 4, 0, 2)
    with pytest.raises(ValueError, match=r"7 training clips are fewer than trainer\.effective_batch=8"):
        KeyedSampler(CLIPS, 0, 1, 8)


def test_two_workers_give_what_none_give(folder: Path) -> None:
    """Also in the second epoch, and after a start in the middle (Lightning issue 21938)."""
    orders = []
    for workers in (0, 2):
        module = DataModule(cfg(folder, {"workers": workers}, batch=2), ["rgb"])
        loader = module.train_dataloader()
        order = [seen(loader), seen(loader)]
        module.start(3)
        orders.append([*order, seen(loader), seen(loader)])
    assert orders[0] == orders[1]
    first, second, rest, third = orders[0]
    assert [len(part) for part in orders[0]] == [8, 8, 4, 8]
    assert rest == second[4:]
    assert {epoch for _, epoch, _ in third} == {2}
    assert {number for number, _, _ in first} == {0, 1, 4, 5, 8, 9}


def test_what_is_skipped_is_not_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read, keys = LatentCache.__getitem__, []

    def noted(self: LatentCache, key: Any) -> Batch:
        keys.append(key)
        return read(self, key)

    module = DataModule(cfg(folder), ["rgb"])
    monkeypatch.setattr(LatentCache, "__getitem__", noted)
    module.start(5)
    assert len(seen(module.train_dataloader())) == len(keys) == 4


class Recorder(LightningModule):
    """Trains one number, and keeps what it saw."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(()))
        self.seen: Seen = []
        self.validated: list[str] = []

    def training_step(self, batch: Batch, _: int) -> Tensor:
        self.seen += seen([batch])
        return self.weight * batch.latents["rgb"].float().mean()

    def validation_step(self, batch: Batch, _: int) -> None:
        self.validated += batch.ids

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), lr=0.1)


def fit(folder: Path, to: int, done: int = 0, ckpt: Path | None = None, keep: Path | None = None) -> Recorder:
    """Train by Lightning to an optimiser step, with two workers and accumulation; keep checkpoints of each step."""
    module, recorder = DataModule(cfg(folder, {"workers": 2}, batch=2), ["rgb"]), Recorder()
    module.start(done)
    trainer = Trainer(accelerator="cpu", max_steps=to, accumulate_grad_batches=2, use_distributed_sampler=False,
                      logger=False, enable_progress_bar=False, enable_model_summary=False, num_sanity_val_steps=0,
                      callbacks=[ModelCheckpoint(keep, "{step}", save_top_k=-1, every_n_train_steps=1)] if keep else [],
                      enable_checkpointing=bool(keep))  # fmt: skip
    trainer.fit(recorder, datamodule=module, ckpt_path=ckpt, weights_only=False if ckpt else None)
    if keep:
        trainer.save_checkpoint(keep / "end.ckpt")
    return recorder


@pytest.mark.filterwarnings("ignore")
def test_lightning_goes_on_where_it_stopped(folder: Path, tmp_path: Path) -> None:
    """With two workers, at the end of an epoch of two steps, in the middle of one, and after a stop by max_steps."""
    through = fit(folder, 5, keep=tmp_path)
    assert len(through.seen) == 20
    for done in (1, 2, 3):
        assert fit(folder, 5, done=done, ckpt=tmp_path / f"step={done}.ckpt").seen == through.seen[4 * done :]
    fit(folder, 3, keep=tmp_path)
    assert fit(folder, 5, done=3, ckpt=tmp_path / "end.ckpt").seen == through.seen[12:]
    assert through.validated[:6] == [f"clip{k:04}" for k in (2, 3, 6, 7, 10, 11)]


def test_validation_clips_come_in_a_fixed_order(folder: Path) -> None:
    (loader,) = DataModule(cfg(folder, {"val_limit": 3}), ["rgb"]).val_dataloader()
    assert seen(loader) == seen(loader) == [(2, 0, 0), (3, 0, 1), (6, 0, 2)]
    assert DataModule(cfg(folder, {"val_split": "none"}), ["rgb"]).val_dataloader() == []


def test_a_rank_validates_every_second_clip(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = DataModule(cfg(folder), ["rgb"])
    numbers = []
    for rank in range(2):
        monkeypatch.setattr(module, "_ranks", lambda rank=rank: (rank, 2))
        numbers.append([number for number, _, _ in seen(module.val_dataloader()[0])])
    assert numbers == [[2, 6, 10], [3, 7, 11]]


def test_clips_are_chosen_by_split_object_and_number(folder: Path) -> None:
    module = DataModule(cfg(folder, {"objects": ["duck", "star"], "limit": 2, "val_limit": 0}, effective_batch=2),
                        ["rgb", "stress"])  # fmt: skip
    assert (module.train_clips, module.val_clips) == ([1, 5], [3, 7, 11])
    assert module.steps_per_epoch == 1
    assert list(next(iter(module.train_dataloader())).latents) == ["rgb", "stress"]


@pytest.mark.parametrize(
    ("data", "model", "trainer", "streams", "told"),
    [
        ({"folder": "nowhere"}, {}, {}, ["rgb"], "data.folder=nowhere is no latent cache: .* fracgen.encode"),
        ({}, {"text_dim": 64}, {}, ["rgb"], "text_dim=64, but the captions .* have 8 channels: set model.text_dim=8"),
        ({}, {"image_dim": 1280}, {}, ["rgb"], "image_dim=1280, but the embeddings .* have 0 channels: encode with"),
        ({}, {}, {"effective_batch": 16}, ["rgb"], "has clips: 6 of split train, 6 of split test .* to at most 6"),
        ({"objects": ["duck"]}, {}, {}, ["rgb"], "effective_batch=4 needs .* of which 3 are of the chosen objects"),
        ({"limit": 2}, {}, {}, ["rgb"], "of which 2 are of the chosen objects and within data.limit"),
    ],
)
def test_what_a_training_lacks_is_named_before_it_starts(
    folder: Path, data: Any, model: Any, trainer: Any, streams: list[str], told: str
) -> None:
    with pytest.raises(ValueError, match=told):
        DataModule(cfg(folder, data, model, **trainer), streams)


def test_a_stream_that_a_stage_needs_is_named(tmp_path: Path) -> None:
    folder = synthetic.write(tmp_path, clips=8, streams=["rgb"], frames=1, size=16, text_dim=8)
    with pytest.raises(ValueError, match="lacks damage; it has rgb: encode with"):
        DataModule(cfg(folder), ["rgb", "damage"])


def test_the_embedding_of_the_picture_is_given_to_models_that_take_it(tmp_path: Path) -> None:
    folder = synthetic.write(tmp_path, clips=8, streams=["rgb"], frames=1, size=16, text_dim=8, image_dim=6)
    with_image = next(iter(DataModule(cfg(folder, model={"image_dim": 6}), ["rgb"]).train_dataloader()))
    assert with_image.image.shape == (1, 257, 6)
    assert next(iter(DataModule(cfg(folder), ["rgb"]).train_dataloader())).image is None
    with pytest.raises(ValueError, match=r"image_dim=1280, .* have 6 channels: .* model\.image_dim=6"):
        DataModule(cfg(folder, model={"image_dim": 1280}), ["rgb"])


def test_a_cache_that_was_made_without_pictures_is_taken_with_a_warning(tmp_path: Path) -> None:
    """The transformer then sees zeros, as on 10 % of the clips that its base was trained on."""
    folder = synthetic.write(tmp_path, clips=8, streams=["rgb"], frames=1, size=16, text_dim=8)
    about = folder / "cache.json"
    about.write_text(about.read_text().replace('"image": ""', '"image": "zeros"'))
    with pytest.warns(UserWarning, match=r"encoders\.image=zeros: the branch .* sees zeros"):
        module = DataModule(cfg(folder, model={"image_dim": 1280}), ["rgb"])
    assert next(iter(module.train_dataloader())).image is None


def test_a_plain_loader_reads_a_cache_too(folder: Path) -> None:
    cache = fracgen.data.open(folder).only(["rgb", "flow"])
    loader = DataLoader(cache, batch_size=5, num_workers=2, collate_fn=fracgen.data.collate)
    assert [name for batch in loader for name in batch.ids] == [row["id"] for row in cache.rows]
