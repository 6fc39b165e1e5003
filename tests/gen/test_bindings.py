"""What diffusers and peft do to a model by its names works on this one: adapters, checkpointing, compiling, ..."""

import pytest
import torch
from peft import LoraConfig

from fracgen.config.model import Lora
from fracgen.model import build

from .networks import inputs, run, small


def gradients(network, call) -> dict[str, torch.Tensor]:
    """Gradients of the mean square of the velocity."""
    network.zero_grad()
    (out,) = network(**call, return_dict=False)
    out.square().mean().backward()
    return {name: p.grad.clone() for name, p in network.named_parameters() if p.grad is not None}


def test_gradient_checkpointing_changes_no_gradient_and_reaches_every_parameter():
    network, call = build(small(rope="shared"), ["rgb", "flow"]).train(), inputs(streams=2)
    plain = gradients(network, call)
    network.enable_gradient_checkpointing()
    recomputed = gradients(network, call)
    assert plain.keys() == recomputed.keys() == dict(network.named_parameters()).keys()
    assert all(torch.equal(plain[name], recomputed[name]) for name in plain)


def test_checkpointing_runs_every_block_again():
    network, call = build(small(), ["rgb"]).train(), inputs()
    passes = []
    network.blocks[1].register_forward_pre_hook(lambda *_: passes.append(1))
    gradients(network, call)
    assert len(passes) == 1
    network.enable_gradient_checkpointing()
    gradients(network, call)
    assert len(passes) == 3
    run(network, call)  # nothing to recompute without gradients
    assert len(passes) == 4


def test_adapters_bind_to_ten_layers_a_block_and_change_nothing_at_first():
    network, call = build(small(), ["rgb"]), inputs()
    before = run(network, call)
    network.add_adapter(LoraConfig(r=2, target_modules=Lora().targets))
    assert sum("lora_A" in name for name, _ in network.named_parameters()) == 2 * 10
    assert torch.equal(run(network, call), before)


def test_adapters_are_part_of_kept_keys_and_values():
    network, call = build(small(), ["rgb"]), inputs()
    network.add_adapter(LoraConfig(r=2, target_modules=["to_k", "to_v"], init_lora_weights=False))
    with network.reuse_context():
        kept = run(network, call)
    assert torch.equal(kept, run(network, call))


@pytest.mark.parametrize("name", ["native", "_native_math"])
def test_a_back_end_of_attention_reaches_every_block(name):
    network, call = build(small(), ["rgb"]), inputs()
    before = run(network, call)
    network.set_attention_backend(name)
    assert all(p._attention_backend.value == name for p in network.attn_processors.values())
    with network.reuse_context():
        kept = run(network, call)
    assert torch.equal(kept, run(network, call))
    torch.testing.assert_close(kept, before, atol=1e-5, rtol=0)  # roundings of another order of sums


def test_blocks_can_be_compiled_and_still_keep_keys_and_values():
    network, call = build(small(), ["rgb"]), inputs()
    before = run(network, call)
    network.compile_repeated_blocks(backend="eager")
    assert torch.equal(run(network, call), before)
    with network.reuse_context():
        assert all(torch.equal(run(network, call), before) for _ in range(3))


def test_context_parallelism_finds_its_modules_and_one_rope_for_all_tokens():
    network, call = build(small(), ["rgb"]), inputs()
    modules = dict(network.named_modules())
    assert all(name in modules for name in network._cp_plan)
    lengths = {}
    network.blocks[0].register_forward_pre_hook(
        lambda _, args: lengths.update(tokens=args[0].shape, cos=args[3][0].shape)
    )
    network.proj_out.register_forward_hook(lambda _, args, out: lengths.update(out=out.shape))
    run(network, call)
    assert lengths == {"tokens": (2, 4 * 6, 48), "cos": (1, 4 * 6, 1, 24), "out": (2, 4 * 6, 64)}


def test_what_diffusers_saves_diffusers_loads(tmp_path):
    network, call = build(small(rope="shared"), ["rgb", "damage"]), inputs(streams=2)
    network.save_pretrained(tmp_path)
    again = type(network).from_pretrained(tmp_path)
    assert again.streams == ("rgb", "damage")
    assert torch.equal(run(again, call), run(network, call))
    coarse = type(network).from_pretrained(tmp_path, torch_dtype=torch.bfloat16)
    ours = build(small(rope="shared"), ["rgb", "damage"], dtype=torch.bfloat16)
    assert {k: v.dtype for k, v in coarse.state_dict().items()} == {k: v.dtype for k, v in ours.state_dict().items()}
