"""Keys and values of caption and picture are kept over the steps of a sampling: exact, and so many FLOPs less."""

from contextlib import nullcontext

import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from fracgen.config.model import Model
from fracgen.layout import STREAMS
from fracgen.model import build, empty

from .networks import inputs, run, small


def steps(network, call, captions) -> list[torch.Tensor]:
    """Velocities of three steps, each with every caption."""
    levels = [torch.full((2,), t) for t in (900.0, 500.0, 100.0)]
    return [run(network, call, timestep=t, encoder_hidden_states=c) for t in levels for c in captions]


@pytest.mark.parametrize("image_dim", [32, 0])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_velocities_with_kept_keys_and_values_are_equal_bit_for_bit(image_dim, dtype):
    network, call = build(small(image_dim=image_dim), ["rgb"], dtype=dtype), inputs(image=image_dim > 0)
    captions = [call["encoder_hidden_states"], torch.zeros_like(call["encoder_hidden_states"])]
    plain = steps(network, call, captions)
    with network.reuse_context():
        kept = steps(network, call, captions)
    after = steps(network, call, captions)
    assert all(torch.equal(a, b) and torch.equal(a, c) for a, b, c in zip(plain, kept, after, strict=True))


def test_a_new_caption_or_picture_is_never_answered_with_an_old_one():
    network, call = build(small(), ["rgb"]), inputs()
    captions = [torch.randn(2, 512, 16) for _ in range(6)]  # more than are kept
    pictures = [torch.randn(2, 257, 32) for _ in range(2)]
    pairs = [(c, p) for c in captions for p in pictures] * 2

    def velocities() -> list[torch.Tensor]:
        return [run(network, call, encoder_hidden_states=c, encoder_hidden_states_image=p) for c, p in pairs]

    plain = velocities()
    with network.reuse_context():
        assert all(torch.equal(a, b) for a, b in zip(plain, velocities(), strict=True))


def test_it_is_for_sampling_only_and_ends_with_the_block():
    network, call = build(small(), ["rgb"]), inputs()
    with network.reuse_context(), pytest.raises(ValueError, match=r"torch\.no_grad"):
        network(**call)
    network.train()
    with pytest.raises(ValueError, match="call eval"), network.reuse_context():
        pass
    assert network(**call).sample.requires_grad


def flops(network, size: int, frames: int = 21, reuse: bool = False) -> int:
    """FLOPs of a step of `frames` latent frames, `size` pixels wide and high; with `reuse` those of the second step."""
    rows, side, dim = len(network.streams) * size // 8, size // 8, network.image_dim
    with torch.device("meta"), torch.no_grad():
        image = torch.empty(1, 257, dim) if dim else None
        call = (torch.empty(1, 48, frames, rows, side), torch.empty(1), torch.empty(1, 512, network.config.text_dim),
                image, torch.empty(1, 16, rows, side))  # fmt: skip
        with network.reuse_context() if reuse else nullcontext():
            if reuse:
                network(*call)
            with FlopCounterMode(display=False) as count:
                network(*call)
        return count.get_total_flops()


def saved(layers: int) -> int:
    """FLOPs of what does not depend on the noise level, from the shapes of its layers."""
    D, text, image = 1536, 512, 257
    embeddings = 2 * text * (4096 * D + D * D) + 2 * image * (1280 * 1280 + 1280 * D)
    return layers * 4 * D**2 * (text + image) + embeddings


def test_the_flops_saved_are_those_of_the_projections():
    network = empty(Model(layers=1), ["rgb"]).eval()
    assert flops(network, 64) - flops(network, 64, reuse=True) == saved(1)


@pytest.mark.parametrize(("streams", "size", "share"), [(["rgb"], 256, 0.011), (STREAMS, 512, 0.00009)])
def test_the_share_that_is_saved_is_the_one_that_the_docstring_states(streams, size, share):
    one, two = (flops(empty(Model(layers=n), streams).eval(), size) for n in (1, 2))
    full = one + 29 * (two - one)  # blocks are alike
    assert saved(30) / full == pytest.approx(share, rel=0.05)  # two digits are stated


def test_a_small_model_of_a_small_clip_is_spared_35_percent():
    cfg = Model(layers=4, heads=4, head_dim=32, ffn_dim=512, text_dim=64, image_dim=0)  # model=tiny
    network = empty(cfg, ["rgb"]).eval()
    assert flops(network, 64, frames=5, reuse=True) / flops(network, 64, frames=5) == pytest.approx(0.65, abs=0.005)
