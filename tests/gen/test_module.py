"""What the module of a stage draws, minimises and trains; its learning rate; and what it does with numbers that are
not finite."""

import gc
import json
from pathlib import Path

import pytest
import torch
from safetensors import safe_open

from fracgen import draws
from fracgen.config.train import Recipe
from fracgen.data import Batch, collate, open
from fracgen.layout import STREAMS, join
from fracgen.training import guard, network, noising, replay, schedule, stages
from fracgen.training.ema import Ema
from fracgen.training.meter import Meter
from fracgen.training.module import Module, decays
from tests.gen.trainings import cache, config, curves, only

REFERENCE = Path(__file__).parents[1] / "reference" / "losses_tiny.json"


@pytest.fixture(scope="module")
def latents(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cache(tmp_path_factory.mktemp("latents"))


@pytest.fixture
def batch(latents: Path) -> Batch:
    """Two clips in slots 0 and 3 of the third epoch."""
    both = collate([open(latents)[k] for k in (0, 4)])
    return both._replace(epoch=torch.tensor([2, 2]), slot=torch.tensor([0, 3]))


def module(latents: Path, *more: str, stage: int = 3) -> Module:
    cfg = config(latents, latents, *more)
    recipe: Recipe = getattr(cfg.stages, f"stage{stage}")
    return Module(cfg, recipe, network.build(cfg, tuple(recipe.streams)), total=10)


def one(batch: Batch, k: int) -> Batch:
    return replay.one(batch, k, torch.device("cpu"))


# What is drawn


def test_noise_levels_are_stratified_over_the_slots_of_the_effective_batch(batch: Batch, latents: Path) -> None:
    """Slot k of 4 draws u in [k / 4, (k + 1) / 4); with shift 1 the noise level is u."""
    cfg = config(latents, latents, "loss.shift=1").loss
    seen = noising.levels(batch, cfg, 0, 4)
    assert 0 <= seen[0] < 0.25
    assert 0.75 <= seen[1] < 1
    for k, slot in enumerate((0, 3)):
        u = draws.uniform(0, 2, int(batch.indices[k]), "level")
        assert seen[k].item() == pytest.approx((slot + u) / 4, rel=1e-6)


def test_the_shift_and_uniform_levels(batch: Batch, latents: Path) -> None:
    """5 u / (1 + 4 u); unstratified, the slot does not matter."""
    cfg = config(latents, latents, "loss.stratified=false").loss
    u = torch.tensor([draws.uniform(0, 2, int(k), "level") for k in batch.indices])
    torch.testing.assert_close(noising.levels(batch, cfg, 0, 4), 5 * u / (1 + 4 * u), rtol=1e-6, atol=0)


def test_draws_belong_to_clip_and_epoch_not_to_place_or_process(batch: Batch) -> None:
    """A clip alone gets what it gets in company; another epoch or seed gets something else."""
    both = noising.noise(batch, 0)
    assert torch.equal(noising.noise(one(batch, 1), 0)[0], both[1])
    assert not torch.equal(noising.noise(batch._replace(epoch=batch.epoch + 1), 0), both)
    assert not torch.equal(noising.noise(batch, 1), both)
    assert torch.equal(noising.noise(batch, 0, validation=True),
                       noising.noise(batch._replace(epoch=batch.epoch + 1), 0, validation=True))  # fmt: skip


def test_conditions_are_left_out_at_the_asked_rate(batch: Batch, latents: Path) -> None:
    """Of 2,000 draws with share 0.3: 600, with a standard deviation of 20; five of these are allowed."""
    many = batch._replace(epoch=torch.arange(2000), indices=torch.zeros(2000, dtype=torch.int64))
    keep = noising.kept(many, 0.3, 0, "text")
    assert keep is not None
    assert abs(2000 - float(keep.sum()) - 600) < 100
    cfg = config(latents, latents, "conditioning.drop_text=1", "conditioning.drop_reference=1").conditioning
    left = noising.inputs(batch, cfg, 0, train=True)
    assert not left.text.any()
    assert not left.reference.any()
    assert noising.inputs(batch, cfg, 0, train=False).text.any()


# What is minimised


def test_the_loss_is_that_of_the_velocity_at_the_drawn_noise_level(batch: Batch, latents: Path) -> None:
    """x lies between data and noise; the target is their difference."""
    m = module(latents)
    drawn = m.draw(batch)
    x0, noise = join(batch.latents).float(), noising.noise(batch, 0)
    s = drawn.sigma.reshape(-1, 1, 1, 1, 1)
    torch.testing.assert_close(drawn.x, (1 - s) * x0 + s * noise, rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(drawn.target, noise - x0, rtol=0, atol=0)
    losses = m.losses(batch, drawn, step=0)
    assert losses.streams.shape == (2, 5)
    torch.testing.assert_close(losses.flow, losses.streams.mean(1), rtol=1e-6, atol=0)
    assert losses.constitutive is not None
    assert losses.total.item() == pytest.approx(losses.flow.mean().item(), rel=1e-6)  # the ramp begins at 0


def test_a_batch_of_two_has_the_mean_loss_and_gradient_of_its_clips(batch: Batch, latents: Path) -> None:
    """float32 sums in another order: 1e-5 of the largest gradient."""
    m = module(latents)
    m.losses(batch, m.draw(batch), step=300).total.backward()
    together = {name: p.grad.clone() for name, p in m.trained() if p.grad is not None}
    m.zero_grad()
    totals = []
    for k in range(2):
        losses = m.losses(one(batch, k), m.draw(one(batch, k)), step=300)
        (losses.total / 2).backward()
        totals.append(losses.total.item())
    assert sum(totals) / 2 == pytest.approx(m.losses(batch, m.draw(batch), 300).total.item(), rel=1e-5)
    largest = max(g.abs().max().item() for g in together.values())
    for name, p in m.trained():
        torch.testing.assert_close(p.grad, together[name], rtol=1e-4, atol=1e-5 * largest)


def test_all_that_is_trained_gets_a_gradient_in_each_stage(batch: Batch, latents: Path) -> None:
    """DistributedDataParallel would wait for one that gets none."""
    for stage in (1, 2, 3):
        m = module(latents, stage=stage)
        shown = batch._replace(latents={name: batch.latents[name] for name in m.streams})
        m.losses(shown, m.draw(shown), step=0).total.backward()
        assert [name for name, p in m.trained() if p.grad is None] == []
    assert [name for name, _ in m.trained() if name.startswith("constitutive.")] == [
        "constitutive.f.weight", "constitutive.f.bias", "constitutive.g.weight", "constitutive.g.bias"]  # fmt: skip


def test_the_constitutive_loss_needs_its_streams(latents: Path) -> None:
    with pytest.raises(ValueError, match=r"lacks stress, which the constitutive loss needs.*constitutive=false"):
        module(latents, "stages.stage3.streams=[rgb,strain,damage]")


def test_the_constitutive_weight_grows_over_the_ramp_and_its_latents_may_wait(batch: Batch, latents: Path) -> None:
    m = module(latents, "loss.lambda_const=0.5", "loss.ramp=10", "loss.detach_stress=5")
    assert [m.constitutive_weight(step) for step in (0, 5, 10, 99)] == [0, 0.25, 0.5, 0.5]
    gradients = []
    for step in (4, 5):  # the last detached step and the first one that is not
        m.zero_grad()
        losses = m.losses(batch, m.draw(batch), step)
        (losses.total - losses.streams.mean()).backward()
        gradients.append(m.transformer.proj_out.weight.grad.clone())
    assert not torch.equal(*gradients)


# What is trained, and how


def test_the_learning_rate_is_a_function_of_the_optimiser_step() -> None:
    """Warm-up over 40 of 240 steps: 1/40 at first, 1 at 39 and 40, half between, nearly 0 at the end."""
    factor = [schedule.learning_rate(step, 40, 240) for step in (0, 19, 39, 40, 140)]
    assert factor == pytest.approx([1 / 40, 0.5, 1.0, 1.0, 0.5], rel=1e-12)
    assert 0 < schedule.learning_rate(239, 40, 240) < 1e-4
    assert schedule.learning_rate(0, 0, 1) == 1.0


def test_steps_of_a_stage() -> None:
    assert schedule.total_steps(Recipe(epochs=3.0), 263) == 789  # 4,212 clips in effective batches of 16
    assert schedule.total_steps(Recipe(epochs=0.5), 263) == 132
    assert schedule.total_steps(Recipe(steps=7), 263) == 7
    assert schedule.total_steps(Recipe(epochs=0.001), 263) == 1


def test_weight_decay_acts_on_matrices_only_and_never_on_the_maps(latents: Path) -> None:
    m = module(latents)
    groups = m.configure_optimizers().param_groups
    decayed = {id(p) for group in groups if group["weight_decay"] for p in group["params"]}
    names = {name for name, p in m.trained() if id(p) in decayed}
    assert names == {name for name, p in m.transformer.named_parameters(prefix="transformer") if decays(name, p)}
    assert not [n for n in names if n.endswith(("bias", "scale_shift_table")) or "norm" in n or "constitutive" in n]
    assert sum(len(group["params"]) for group in groups) == len(list(m.trained()))
    assert groups[-1]["lr"] == m.cfg.loss.const_lr


def test_an_average_takes_the_weights_at_its_first_update_and_is_not_shown_before(latents: Path) -> None:
    """Then it moves by 1 - (1 + n) / (10 + n) of the way, at n = 1 by 9/11, until that is 1 - decay."""
    m, ema = module(latents), Ema(0.99)
    (name, weight), *_ = m.trained()
    before = weight.detach().clone()
    ema.on_validation_start(None, m)
    assert torch.equal(weight, before)
    ema.on_validation_end(None, m)
    ema.update(m)
    with torch.no_grad():
        weight += 1
    ema.update(m)
    torch.testing.assert_close(ema.average[name], before + 9 / 11, rtol=1e-6, atol=1e-6)
    ema.on_validation_start(None, m)
    assert torch.equal(weight, ema.average[name])
    ema.on_validation_end(None, m)
    torch.testing.assert_close(weight, before + 1, rtol=0, atol=0)


# What is logged


def test_a_meter_gives_means_and_bins() -> None:
    meter = Meter()
    meter.add("loss", torch.tensor([1.0, 2.0]))
    meter.add("loss", torch.tensor(6.0))
    meter.add_by_level("error", torch.tensor([1.0, 3.0, 5.0]), torch.tensor([0.05, 0.09, 1.0]))
    meter.add_histogram("sigma", torch.tensor([0.05, 0.09, 1.0, 0.55]))
    means = meter.means()
    assert means["loss"] == 3.0
    assert (means["error/0.0-0.1"], means["error/0.9-1.0"]) == (2.0, 5.0)
    assert "error/0.5-0.6" not in means
    assert [means[f"sigma/{name}"] for name in ("0.0-0.1", "0.5-0.6", "0.9-1.0", "0.3-0.4")] == [0.5, 0.25, 0.25, 0]
    assert meter.means() == {}


def test_curves_tell_losses_by_stream_and_noise_level_speed_and_memory(latents: Path, tmp_path: Path) -> None:
    stages.run(config(tmp_path, latents, "stage=3", "init_from=none"))
    rows = curves(only(tmp_path, 3))
    last = rows[4]
    names = (*STREAMS, "total", "matching", "const", "const_share", "const_weight")
    assert {f"loss/{name}" for name in names} <= set(last)
    assert last["loss/matching"] == pytest.approx(sum(last[f"loss/{name}"] for name in STREAMS) / len(STREAMS))
    assert {"gate/mean", "gate/std", "grad_norm", "lr", "lr_const", "epoch", "norm/trained", "norm/const_maps"} <= set(
        last
    )
    assert sum(v for name, v in last.items() if name.startswith("sigma/")) == pytest.approx(1, abs=1e-6)
    assert {f"val/loss/{name}/sigma/0.2-0.3" for name in STREAMS} <= set(last)
    text = (only(tmp_path, 3) / "metrics.csv").read_text()
    assert all(
        name in text for name in ("speed/clips_per_s", "speed/tokens_per_s", "speed/data_wait", "memory/peak_gb")
    )
    ratio = last["loss/const"] / last["loss/matching"]
    assert last["loss/const_share"] == pytest.approx(last["loss/const_weight"] * ratio)


def test_validations_keep_no_memory(latents: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As many tensors are alive at the first forward pass behind the second validation as behind the first."""
    alive: list[int] = []
    original = Module.training_step

    def counted(self: Module, batch: Batch, batch_idx: int) -> torch.Tensor:
        if batch_idx in (8, 16):
            gc.collect()
            alive.append(sum(issubclass(type(thing), torch.Tensor) for thing in gc.get_objects()))
        return original(self, batch, batch_idx)

    monkeypatch.setattr(Module, "training_step", counted)
    stages.run(config(tmp_path, latents))
    assert alive[1] <= alive[0]


def test_losses_of_a_fixed_run_are_those_of_the_reference(latents: Path, tmp_path: Path) -> None:
    """Five steps of stage 3. 1e-4: float32 rounding, 1e-7 an operation, over the few hundred operations of a forward
    pass, and five optimiser steps that repeat it. `tests/reference/losses_tiny.json` was written by this very test from
    the losses of one CPU; remove the file to write it again."""
    stages.run(config(tmp_path, latents, "stage=3", "init_from=none", "stages.stage3.steps=5", "loss.ramp=2"))
    columns = ("loss/total", *(f"loss/{name}" for name in STREAMS), "loss/const", "grad_norm")
    found = {str(step): {name: row[name] for name in columns} for step, row in curves(only(tmp_path, 3)).items()}
    if not REFERENCE.exists():
        REFERENCE.write_text(json.dumps(found, indent=1) + "\n")
    reference = json.loads(REFERENCE.read_text())
    assert found.keys() == reference.keys()
    for step, row in reference.items():
        assert found[step] == pytest.approx(row, rel=1e-4)


# Numbers that are not finite


@pytest.mark.parametrize("poison", ["loss", "gradient"])
def test_a_step_that_is_not_finite_is_not_taken_and_can_be_computed_again(
    poison: str, latents: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the second optimiser step: a weight that overflows, or a gradient that does."""
    original = Module.training_step

    def poisoned(self: Module, batch: Batch, batch_idx: int) -> torch.Tensor:
        if batch_idx == 5 and poison == "loss":
            with torch.no_grad():
                next(p for n, p in self.trained() if n.endswith("blocks.0.ffn.net.2.weight")).fill_(float("inf"))
        loss = original(self, batch, batch_idx)
        return loss * (float("inf") if batch_idx == 5 and poison == "gradient" else 1.0)

    monkeypatch.setattr(Module, "training_step", poisoned)
    with pytest.raises(
        ValueError, match=rf"the {poison} is not finite in optimiser step 1, with clips clip.*; .*replay=.*nan-1"
    ) as told:
        stages.run(config(tmp_path, latents))
    assert str(only(tmp_path)) in str(told.value)
    file = only(tmp_path) / "nan-1.safetensors"
    with safe_open(str(file), framework="pt") as content:
        about = json.loads(content.metadata()["about"])
        assert content.get_tensor(f"{guard.BATCH}latents.rgb").shape == (len(about["ids"]), 16, 2, 2, 2)
    assert about["step"] == 1
    report = replay.run(file)
    assert about["ids"][0] in report
    broken = "first not finite: transformer.blocks.0.ffn.net.2"
    assert (broken in report) == ("loss nan" in report) == (poison == "loss")
