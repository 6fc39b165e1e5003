"""A frozen base in 8 bits: how far off it is, and that adapters learn on it."""

import pytest
import torch

from fracgen.memory import checkpointing, offload, quantise
from fracgen.model import adapter
from tests.gen.small import config, equal, forward, gradients, plain, prepared, train


def test_int8_is_off_by_at_most_half_a_step():
    """Step = largest of the row / 127; 1e-6 for the rounding of float32."""
    weight = torch.randn(64, 96, generator=torch.Generator().manual_seed(0)) * torch.logspace(-6, 6, 64)[:, None]
    codes, scale = quantise.quantise(weight, "int8")
    step = weight.abs().amax(dim=1, keepdim=True) / 127
    assert ((quantise.restore(codes, scale) - weight).abs() <= step / 2 * (1 + 1e-6) + step * 1e-5).all()


def test_float8_is_off_by_at_most_a_sixteenth_or_half_the_least_step():
    """e4m3: half of 2^-3 of the leading power of two; below 2^-6, half of 2^-9, in units of the scale."""
    weight = torch.randn(64, 96, generator=torch.Generator().manual_seed(0)) * torch.logspace(-6, 6, 64)[:, None]
    codes, scale = quantise.quantise(weight, "float8")
    bound = torch.maximum(weight.abs() / 16, weight.abs().amax(dim=1, keepdim=True) / 448 / 1024)
    assert ((quantise.restore(codes, scale) - weight).abs() <= bound * (1 + 1e-5)).all()


def test_a_row_of_zeros_stays_zero():
    for kind in quantise.DTYPES:
        assert not quantise.restore(*quantise.quantise(torch.zeros(2, 3), kind)).any()


@pytest.mark.parametrize("kind", ["int8", "float8"])
def test_a_quantised_layer_is_the_layer_with_the_restored_weight(kind):
    """Its output is off by at most sum_j |x_j| |error of w_ij|, with the bounds of the weights."""
    torch.manual_seed(0)
    linear = torch.nn.Linear(32, 16)
    linear.requires_grad_(False)
    x = torch.randn(5, 32)
    largest = linear.weight.abs().amax(dim=1, keepdim=True)
    error = (
        largest.expand(-1, 32) / 254 if kind == "int8" else torch.maximum(linear.weight.abs() / 16, largest / 458752)
    )
    got = quantise.QuantisedLinear(linear, kind)(x)
    assert ((got - linear(x)).abs() <= x.abs() @ error.T * 1.001 + 1e-6).all()


@pytest.mark.parametrize("kind", ["int8", "float8"])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_a_quantised_base_is_small_learns_and_keeps_its_codes(kind, dtype):
    cfg = config()
    transformer = plain(cfg, dtype=dtype)
    adapter.prepare(transformer, cfg)
    linears = sum(p.numel() for n, p in transformer.blocks.named_parameters() if n.endswith("base_layer.weight"))
    before = sum(p.nbytes for p in transformer.parameters() if not p.requires_grad)
    assert quantise.quantise_base(transformer, kind) == 2 * 10
    codes = {n: p.clone() for n, p in transformer.named_parameters() if not p.requires_grad}
    rows = sum(p.numel() for n, p in transformer.named_parameters() if n.endswith(".scale"))
    assert sum(c.nbytes for c in codes.values()) == before - linears * (dtype.itemsize - 1) + 4 * rows
    for _ in range(2):  # autocast keeps cast weights until its end, so that every step has its own
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=dtype == torch.bfloat16):
            train(transformer, steps=1)
    assert min(adapter.norms(transformer).values()) > 0
    assert all(torch.equal(p, codes[n]) for n, p in transformer.named_parameters() if n in codes)


def test_a_quantised_base_predicts_nearly_the_same():
    """int8 is off by 1/254 of the largest weight of a row, that is under 1 % of the output of a layer."""
    transformer = prepared()
    with torch.no_grad():
        expected = forward(transformer)
        quantise.quantise_base(transformer, "int8")
        error = (forward(transformer) - expected).norm() / expected.norm()
    assert error < 0.01


def test_quantising_is_refused_where_all_weights_are_trained():
    with pytest.raises(ValueError, match=r"trainer.base_dtype=int8 needs frozen weights.*model.train=lora"):
        quantise.quantise_base(prepared(train="full"), "int8")


@pytest.mark.parametrize("kind", ["int8", "float8"])
def test_8_bits_offload_and_selective_checkpointing_go_together(kind):
    """The gradients are those of 8 bits alone."""
    transformer, other = prepared(), prepared()
    for network in (transformer, other):
        quantise.quantise_base(network, kind)
    checkpointing.set_mode(other, "selective")
    offload.offload_blocks(other, 2)
    assert equal(gradients(other), gradients(transformer))
