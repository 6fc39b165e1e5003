"""The transformer: what it shares with Wan bit for bit, what the reference tokens add, and what it computes."""

import pytest
import torch
from diffusers import WanTransformer3DModel
from torch import Tensor

from fracgen.denoiser import Inputs, velocity
from fracgen.layout import STREAMS
from fracgen.model import FracTransformer, build
from fracgen.model.released import to_released

from .naive_wan import NaiveWan
from .networks import IMAGE, TEXT, inputs, run, small


def naive(network: FracTransformer, call: dict[str, Tensor | None], rows: int) -> Tensor:
    """The same clips by the formulas, one by one."""
    oracle = NaiveWan({to_released(k): v for k, v in network.state_dict().items()}, heads=2, rows=rows)
    clips = zip(*(call[k] if call[k] is not None else [None] * 2 for k in call), strict=True)
    return torch.stack([oracle(x, float(t), *rest) for x, t, *rest in clips])


def test_without_reference_it_is_diffusers_wan_bit_for_bit():
    network, call = build(small(), ["rgb"]), inputs()
    plain = WanTransformer3DModel(
        num_attention_heads=2, attention_head_dim=24, ffn_dim=64, num_layers=2, text_dim=TEXT, image_dim=IMAGE,
        added_kv_proj_dim=48, in_channels=48, out_channels=16,
    ).eval()  # fmt: skip
    own = {"ref_conv.weight", "ref_conv.bias"}
    plain.load_state_dict({k: v for k, v in network.state_dict().items() if k not in own})
    del call["reference"]
    assert torch.equal(run(network, call), run(plain, call))


@pytest.mark.parametrize("image", [True, False])
@pytest.mark.parametrize(("rope", "rows"), [("continuous", 1024), ("shared", 2)])
def test_it_computes_the_formulas_of_wan_with_reference_tokens_at_time_zero(image, rope, rows):
    call = inputs(streams=2, image=image)
    network = build(small(rope=rope, image_dim=IMAGE if image else 0), ["rgb", "stress"])
    expected = naive(network, call, rows)
    # float32 has 6e-8; a few hundred roundings of numbers near 1 add up to less than 1e-5
    assert (run(network, call) - expected).abs().max() < 1e-5 * expected.abs().max().clamp(min=1)


def test_training_and_sampling_call_it_by_noise_level():
    network, call = build(small(), ["rgb"]), inputs()
    x, channels = call["hidden_states"].split([16, 32], dim=1)
    seen = Inputs(channels, call["reference"], call["encoder_hidden_states"], call["encoder_hidden_states_image"])
    with torch.no_grad():
        v = velocity(network, x, call["timestep"] / 1000, seen)
    torch.testing.assert_close(v, run(network, call), atol=1e-5, rtol=0)  # 1000 (t / 1000) is t but for rounding


def test_two_clips_give_what_each_gives_alone():
    network, call = build(small(), ["rgb"]), inputs()
    alone = [run(network, {k: v[n : n + 1] for k, v in call.items()}) for n in range(2)]
    # products of other shapes sum in another order: roundings of float32 again
    torch.testing.assert_close(run(network, call), torch.cat(alone), atol=1e-5, rtol=0)


def test_the_reference_leaves_no_trace_in_the_shape_but_changes_the_velocity():
    network, call = build(small(), ["rgb"]), inputs()
    first, none = run(network, call), run(network, call, reference=None)
    other = run(network, call, reference=-call["reference"])
    assert first.shape == none.shape == (2, 16, 3, 4, 6)
    assert (first - other).abs().max() > 1e-3
    assert (first - none).abs().max() > 1e-3


def test_an_image_left_out_is_an_image_of_zeros():
    network, call = build(small(), ["rgb"]), inputs()
    zeros = run(network, call, encoder_hidden_states_image=torch.zeros(2, 257, IMAGE))
    assert torch.equal(run(network, call, encoder_hidden_states_image=None), zeros)


def exchanged(x: Tensor) -> Tensor:
    """A joint latent of five streams whose second and fourth stream have changed places."""
    one, two, three, four, five = x.chunk(5, dim=-2)
    return torch.cat([one, four, three, two, five], dim=-2)


@pytest.mark.parametrize(("rope", "same"), [("shared", True), ("continuous", False)])
def test_maps_that_change_places_do_so_in_the_velocity_under_a_shared_rope_only(rope, same):
    network, call = build(small(rope=rope), STREAMS), inputs(streams=5)
    moved = {name: exchanged(call[name]) for name in ("hidden_states", "reference")}
    difference = (exchanged(run(network, call)) - run(network, call | moved)).abs().max()
    assert difference < 1e-5 if same else difference > 1e-3  # as above: roundings, or not


def test_the_learned_embedding_of_maps_tells_them_apart_by_name():
    two, five = build(small(rope="shared"), ["rgb", "damage"]), build(small(rope="shared"), STREAMS)
    assert two.map_embed.shape == five.map_embed.shape == (5, 48)
    assert not two.map_embed.any()
    call = inputs(streams=2)
    before = run(two, call)
    with torch.no_grad():
        two.map_embed[STREAMS.index("stress")] = 1.0  # not among its streams
    assert torch.equal(run(two, call), before)
    with torch.no_grad():
        two.map_embed[STREAMS.index("damage")] = 1.0
    assert not torch.equal(run(two, call), before)


def test_a_timestep_is_not_rounded_even_in_bfloat16():
    network, call = build(small(), ["rgb"], dtype=torch.bfloat16), inputs()
    near = run(network, call, timestep=torch.tensor([900.0, 900.0]))
    # bfloat16 has 8 bits: around 900 its numbers are 4 apart, so that 900 and 901 would be one
    assert not torch.equal(near, run(network, call, timestep=torch.tensor([901.0, 901.0])))
    embedded, _ = network._time(torch.tensor([900.25]), torch.bfloat16)
    exact, _ = build(small(), ["rgb"])._time(torch.tensor([900.25]), torch.float32)
    assert torch.equal(embedded, exact)


def test_under_mixed_precision_the_timestep_is_still_embedded_in_float32():
    network = build(small(), ["rgb"])
    exact, _ = network._time(torch.tensor([900.25]), torch.float32)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        mixed, _ = network._time(torch.tensor([900.25]), torch.bfloat16)
        out = run(network, inputs())
    assert torch.equal(mixed, exact)
    assert out.dtype == torch.float32


def test_bfloat16_stays_near_float32():
    call = inputs()
    exact, coarse = (run(build(small(), ["rgb"], dtype=d), call) for d in (torch.float32, torch.bfloat16))
    assert coarse.dtype == torch.float32
    # 2^-9 a rounding, some thirty roundings in a row over two blocks, at random: 2^-9 * sqrt(30) = 1 %
    assert (exact - coarse).norm() < 0.02 * exact.norm()
