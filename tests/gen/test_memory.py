"""What saves memory and time in training: nothing of it changes what is computed, or the change is bounded."""

import weakref
from importlib.util import find_spec

import pytest
import torch
from lightning.pytorch.plugins.precision import MixedPrecision
from torch.utils._python_dispatch import TorchDispatchMode

from fracgen.config.train import Trainer
from fracgen.memory import attention, checkpointing, compiling, offload, optimiser, parallel
from tests.gen.small import config, equal, forward, gradients, plain, prepared, train


class Count(TorchDispatchMode):
    """How often attention runs."""

    def __init__(self):
        super().__init__()
        self.itself = self.context = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        if func.name().startswith("aten::_scaled_dot_product") and "backward" not in func.name():
            same = args[0].shape == args[1].shape
            self.itself += same
            self.context += not same
        return func(*args, **(kwargs or {}))


@pytest.mark.parametrize("mode", ["full", "selective"])
@pytest.mark.parametrize("train_", ["lora", "full"])
def test_checkpointing_does_not_change_any_gradient(mode, train_):
    transformer = prepared(train=train_)
    checkpointing.set_mode(transformer, "none")
    expected = gradients(transformer)
    checkpointing.set_mode(transformer, mode)
    assert equal(gradients(transformer), expected)


@pytest.mark.parametrize(("mode", "itself", "context"), [("none", 1, 1), ("full", 2, 2), ("selective", 1, 2)])
def test_selective_checkpointing_runs_self_attention_once_and_full_twice(mode, itself, context):
    """Two blocks, each with one attention to the clip itself and one to the caption."""
    transformer = prepared()
    checkpointing.set_mode(transformer, mode)
    with Count() as count:
        gradients(transformer)
    assert (count.itself, count.context) == (2 * itself, 2 * context)


def test_operators_of_attention_are_those_of_this_pytorch():
    names = [name.removeprefix("aten::") for name in checkpointing.ATTENTION if name.startswith("aten::")]
    assert len(names) == 5
    assert all(hasattr(torch.ops.aten, name) for name in names)


def test_a_back_end_that_is_many_operators_is_recomputed_exactly_too():
    transformer = prepared()
    attention.set_backend(transformer, "_native_math")
    expected = gradients(transformer)
    checkpointing.set_mode(transformer, "selective")
    assert equal(gradients(transformer), expected)
    attention.set_backend(transformer, "native")


def test_an_unknown_mode_of_checkpointing_is_refused():
    with pytest.raises(ValueError, match=r"trainer.checkpointing=some is not allowed: .* none, full, selective"):
        checkpointing.set_mode(plain(config()), "some")


def test_back_ends_of_attention_agree():
    """Sums of up to 16 products in another order: a few ulp of float32, amplified by two blocks."""
    transformer = prepared()
    attention.set_backend(transformer, "native")
    expected = forward(transformer)
    attention.set_backend(transformer, "_native_math")
    got = forward(transformer)
    attention.set_backend(transformer, "native")
    torch.testing.assert_close(got, expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(("name", "reason"), [("fast", "there is no such back-end"), ("_native_cudnn", "No viable"),
                                              ("flash_hub", "kernels")])  # fmt: skip
def test_a_back_end_that_is_not_there_is_refused_with_those_that_are(name, reason):
    with pytest.raises(ValueError, match=rf"trainer.attention={name} cannot be used .*{reason}.*it has native, .*math"):
        attention.set_backend(plain(config()), name)


def test_blocks_are_compiled_or_the_reason_is_given():
    """The first forward pass would compile a block, in half a minute; the compiler itself has been tried out here."""
    transformer = prepared(layers=1)
    if compiling._fault("cpu", "inductor"):
        with pytest.raises(ValueError, match=r"trainer.compile=true: torch.compile does not work"):
            compiling.compile_blocks(transformer)
    else:
        compiling.compile_blocks(transformer)
        assert compiling.is_compiled(transformer)


@pytest.mark.parametrize("mode", checkpointing.MODES)
def test_compiled_blocks_have_the_same_gradients_in_every_mode_of_checkpointing(mode):
    """aot_eager traces forward and backward pass as for the compiler, and runs them without it."""
    transformer = prepared(layers=2)
    expected = gradients(transformer)
    compiling.compile_blocks(transformer, backend="aot_eager")
    checkpointing.set_mode(transformer, mode)
    got = gradients(transformer)
    for name, value in expected.items():
        torch.testing.assert_close(got[name], value, rtol=1e-4, atol=1e-6)
    with pytest.raises(ValueError, match=r"trainer.offload_blocks=1 (needs|does not go with compiled blocks)"):
        offload.offload_blocks(transformer, 1)


def test_a_machine_that_cannot_compile_says_why(monkeypatch):
    def broken(function, backend):
        raise RuntimeError("no compiler found\nmore")

    monkeypatch.setattr(torch, "compile", broken)
    compiling._fault.cache_clear()
    with pytest.raises(ValueError, match=r"trainer.compile=true: .*no compiler found\).*trainer.compile=false"):
        compiling.compile_blocks(plain(config()))
    compiling._fault.cache_clear()


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("mode", ["full", "selective"])
def test_offloaded_blocks_give_the_same_gradients_and_learn(count, mode):
    transformer, other = prepared(), prepared()
    checkpointing.set_mode(transformer, mode)
    checkpointing.set_mode(other, mode)
    waiting = offload.offload_blocks(other, count)
    assert equal(gradients(other), gradients(transformer))
    train(transformer, steps=2)
    train(other, steps=2)
    waiting.remove()
    assert equal(dict(other.named_parameters()), dict(transformer.named_parameters()))


def test_only_frozen_weights_wait_and_they_leave_no_copy_behind():
    transformer = prepared()
    frozen = {n: p.nbytes for n, p in transformer.blocks.named_parameters() if not p.requires_grad}
    checkpointing.set_mode(transformer, "full")
    waiting = offload.offload_blocks(transformer, 2)
    assert waiting.bytes_waiting() == sum(frozen.values())
    empty = {n for n, p in transformer.blocks.named_parameters() if not p.numel()}
    assert empty == set(frozen)
    assert not waiting.fetched
    with pytest.raises(ValueError, match=r"trainer.compile=true does not go with offloaded blocks"):
        compiling.compile_blocks(transformer)


@pytest.mark.parametrize(("ahead", "most"), [(False, 1), (True, 2)])
def test_weights_of_one_block_at_a_time_are_on_the_device_or_of_two_when_fetched_ahead(monkeypatch, ahead, most):
    """Each block comes once forward and once backward, and is gone when the next one but `most` comes."""
    transformer = prepared(layers=4)
    checkpointing.set_mode(transformer, "full")
    waiting = offload.offload_blocks(transformer, 4)
    waiting.ahead = ahead  # as on CUDA
    one = waiting.bytes_waiting() // 4
    alive, peaks, order = weakref.WeakSet(), [], []
    fetch = waiting._fetch

    def spy(index, device):
        fetch(index, device)
        alive.update(t.untyped_storage() for t in waiting.fetched[index])
        peaks.append(sum(storage.nbytes() for storage in alive))
        order.append(index)

    monkeypatch.setattr(waiting, "_fetch", spy)
    got = gradients(transformer)
    assert order == [0, 1, 2, 3, 3, 2, 1, 0]
    assert max(peaks) == most * one
    assert not alive
    waiting.remove()
    assert equal(gradients(transformer), got)


def test_offloading_is_refused_where_it_cannot_work():
    transformer = prepared()
    with pytest.raises(ValueError, match=r"trainer.offload_blocks=1 needs gradient checkpointing"):
        offload.offload_blocks(transformer, 1)
    with pytest.raises(ValueError, match=r"trainer.offload_blocks=3 is more than the 2 blocks"):
        offload.offload_blocks(transformer, 3)
    assert offload.offload_blocks(transformer, 0) is None


def test_adamw_keeps_the_settings_of_its_groups():
    a, b = torch.nn.Parameter(torch.ones(3)), torch.nn.Parameter(torch.ones(2))
    groups = [{"params": [a], "lr": 1e-4}, {"params": iter([b]), "lr": 1e-3, "weight_decay": 0.0}]
    out = optimiser.build(groups, Trainer(weight_decay=0.3))
    assert isinstance(out, torch.optim.AdamW)
    assert [(g["lr"], g["weight_decay"]) for g in out.param_groups] == [(1e-4, 0.3), (1e-3, 0.0)]


def test_gradients_can_be_clipped_under_mixed_precision():
    """Lightning refuses it to optimisers that declare to undo loss scaling, as fused ones do."""
    a = torch.nn.Parameter(torch.zeros(4))
    out = optimiser.build([{"params": [a], "lr": 1e-3}], Trainer())
    a.grad = torch.full((4,), 10.0)
    MixedPrecision("bf16-mixed", "cpu").clip_gradients(out, 1.0)
    torch.testing.assert_close(a.grad.norm(), torch.tensor(1.0))
    out.step()
    assert (a < 0).all()


def test_adamw_of_8_bits_reaches_the_minimum_or_names_the_extra():
    goal = torch.linspace(-1, 1, 8192)
    x = torch.nn.Parameter(torch.zeros(8192))
    groups = [{"params": [x], "lr": 0.02}]
    if find_spec("bitsandbytes") is None:
        with pytest.raises(ValueError, match=r"trainer.optimizer=adamw8bit needs .*bitsandbytes.*fracsim\[lowmem\]"):
            optimiser.build(groups, Trainer(optimizer="adamw8bit"))
        return
    out = optimiser.build(groups, Trainer(optimizer="adamw8bit", weight_decay=0.0))
    for _ in range(100):
        out.zero_grad()
        (x - goal).square().sum().backward()
        out.step()
    assert (x - goal).square().mean() < 0.01 * goal.square().mean()


def test_an_optimiser_of_nothing_is_refused():
    with pytest.raises(ValueError, match=r"nothing is trained: set model.train"):
        optimiser.build([{"params": [], "lr": 1.0}], Trainer())


def test_context_parallelism_is_refused_where_it_cannot_work():
    transformer = plain(config())
    parallel.enable_context_parallel(transformer, 1)
    with pytest.raises(ValueError, match=r"trainer.context_parallel=5 must divide the 12 heads .* 1, 2, 3, 4, 6, 12"):
        parallel.check(5, 12)
    with pytest.raises(ValueError, match=r"trainer.context_parallel=2 must divide the 5633 tokens"):
        parallel.check(2, 12, 5633)
    parallel.check(4, 12, 171_600)
    with pytest.raises(ValueError, match=r"trainer.context_parallel=2 needs CUDA devices"):
        parallel.enable_context_parallel(transformer, 2)
