"""What is trained of the transformer: how much, in which type, and that nothing else moves."""

import pytest
import torch

from fracgen.config.model import Lora, Model
from fracgen.model import adapter
from tests.gen.small import config, forward, plain, train


def frozen(transformer):
    return {n: p.detach().clone() for n, p in transformer.named_parameters() if not p.requires_grad}


def names(transformer):
    return {n for n, _ in adapter.trained(transformer)}


def test_lora_of_the_full_model_touches_300_linears_and_87490560_parameters():
    """30 blocks of 10 linears: of dim 1536 to 1536 (8 of them) and 1536 to or from 8960 (2), at rank 64."""
    transformer = plain(Model(), device="meta")
    adapter.prepare(transformer, Model())
    assert len(names(transformer)) == 2 * 300  # lora_A and lora_B
    total = sum(p.numel() for _, p in adapter.trained(transformer))
    assert total == 87_490_560 == 30 * 64 * (8 * (1536 + 1536) + 2 * (1536 + 8960))


def test_trained_parameters_are_float32_while_the_base_keeps_its_type():
    transformer = plain(config(), dtype=torch.bfloat16)
    before = {id(p): p.dtype for p in transformer.parameters()}
    assert set(before.values()) == {torch.bfloat16, torch.float32}
    adapter.prepare(transformer, config(train_patch_embed="new_channels"))
    assert {p.dtype for p in transformer.parameters() if p.requires_grad} == {torch.float32}
    assert all(p.dtype == before[id(p)] for p in transformer.parameters() if not p.requires_grad)


def test_a_new_adapter_changes_nothing_and_says_so():
    transformer = plain(config())
    before = forward(transformer)
    adapter.prepare(transformer, config())
    assert adapter.is_zero(transformer)
    assert torch.equal(forward(transformer), before)


def test_the_seed_and_nothing_else_decides_the_first_adapter():
    states = []
    for noise in (1, 2):
        transformer = plain(config())
        torch.manual_seed(noise)
        adapter.prepare(transformer, config())
        states.append({n: p.detach() for n, p in adapter.trained(transformer)})
    assert all(torch.equal(states[0][n], states[1][n]) for n in states[0])


@pytest.mark.parametrize("checkpointing", [False, True])
def test_two_steps_move_every_adapter_and_no_frozen_weight(checkpointing):
    transformer = plain(config())
    adapter.prepare(transformer, config())
    if checkpointing:
        transformer.enable_gradient_checkpointing()
    before = frozen(transformer)
    train(transformer, steps=2)
    norms = adapter.norms(transformer)
    assert len(norms) == 20
    assert min(norms.values()) > 0
    assert not adapter.is_zero(transformer)
    assert all(torch.equal(p, before[n]) for n, p in transformer.named_parameters() if n in before)


@pytest.mark.parametrize(("choice", "trained"), [("none", 0), ("full", 2), ("new_channels", 1)])
def test_the_layer_of_the_condition_channels_is_trained_as_told(choice, trained):
    transformer = plain(config())
    before = forward(transformer)
    adapter.prepare(transformer, config(train_patch_embed=choice))
    assert sum("patch_embedding" in n for n in names(transformer)) == trained
    assert torch.equal(forward(transformer), before)


def test_of_the_condition_channels_only_the_six_scalars_move_also_under_weight_decay():
    transformer = plain(config())
    adapter.prepare(transformer, config(train_patch_embed="new_channels"))
    layer = transformer.patch_embedding
    before, bias = layer.weight.detach().clone(), layer.bias.detach().clone()
    train(transformer, steps=3, weight_decay=0.5)
    moved = (layer.weight.detach() != before).flatten(2).any(dim=2).any(dim=0)
    assert moved.nonzero().flatten().tolist() == [32, 33, 34, 35, 36, 37]
    assert torch.equal(layer.bias, bias)


def test_full_training_trains_every_weight_in_float32():
    transformer = plain(config(), dtype=torch.bfloat16)
    adapter.prepare(transformer, config(train="full"))
    assert names(transformer) == {n for n, _ in transformer.named_parameters()}
    assert {p.dtype for p in transformer.parameters()} == {torch.float32}
    assert adapter.norms(transformer) == {}


def test_a_second_adapter_is_told_apart_by_its_name():
    """peft leaves the adapter that is added last the only active and the only trained one."""
    transformer = plain(config())
    adapter.prepare(transformer, config())
    adapter.add(transformer, Lora(rank=2, alpha=2.0), name="second")
    assert transformer.active_adapters() == ["second"]
    assert all(".second." in n for n in names(transformer))
    transformer.set_adapter(adapter.ADAPTER)
    assert all(".default." in n for n in names(transformer))
    train(transformer, steps=2)
    assert adapter.is_zero(transformer, "second")
    assert not adapter.is_zero(transformer, adapter.ADAPTER)


def test_a_target_that_names_no_layer_is_refused():
    with pytest.raises(ValueError, match=r"model.lora.targets=.*to_w names no linear layer.*to_q"):
        adapter.prepare(plain(config()), config(lora=Lora(targets=["to_q", "to_w"])))


def test_new_channels_are_refused_where_all_channels_are_trained():
    with pytest.raises(ValueError, match=r"model\.train_patch_embed=new_channels"):
        adapter.prepare(plain(config()), config(train="full", train_patch_embed="new_channels"))
