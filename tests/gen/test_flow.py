"""Flow matching in closed form: end points, the velocity, the estimate of x0, noise levels; one call of the network."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from fracgen import denoiser, flow

SHIFTS = st.floats(0.1, 100)


def pair(*shape: int) -> tuple[Tensor, Tensor]:
    """Data and noise that are small whole numbers, so that sums with dyadic levels are exact."""
    generator = torch.Generator().manual_seed(0)
    return tuple(torch.randint(-8, 9, shape, generator=generator).float() for _ in range(2))  # type: ignore[return-value]


def test_noise_level_0_is_data_and_1_is_noise() -> None:
    x0, noise = pair(2, 16, 3, 4, 5)
    x = flow.noisy(x0, noise, torch.tensor([0.0, 1.0]))
    assert torch.equal(x[0], x0[0])
    assert torch.equal(x[1], noise[1])


def test_the_true_velocity_gives_back_x0_exactly_at_each_level() -> None:
    """Bit for bit: whole numbers times sixteenths have no rounding in float32."""
    sigma = torch.arange(17.0) / 16
    x0, noise = pair(17, 3, 4)
    assert torch.equal(flow.clean(flow.noisy(x0, noise, sigma), flow.velocity(x0, noise), sigma), x0)


def test_the_velocity_is_the_slope_of_the_path() -> None:
    x0, noise = pair(1, 7)
    low, high = torch.tensor([0.25]), torch.tensor([0.75])
    slope = (flow.noisy(x0, noise, high) - flow.noisy(x0, noise, low)) / 0.5
    assert torch.equal(slope, flow.velocity(x0, noise))


def test_each_clip_of_a_batch_has_its_own_level() -> None:
    x0, noise = pair(3, 2, 2)
    sigma = torch.tensor([0.0, 0.5, 1.0])
    alone = [flow.noisy(x0[k : k + 1], noise[k : k + 1], sigma[k : k + 1]) for k in range(3)]
    assert torch.equal(flow.noisy(x0, noise, sigma), torch.cat(alone))


@given(SHIFTS)
def test_shifted_levels_keep_their_ends(shift: float) -> None:
    ends = flow.shifted(torch.tensor([0.0, 1.0], dtype=torch.float64), shift)
    assert ends.tolist() == pytest.approx([0, 1], abs=1e-12)


@given(SHIFTS)
def test_shifted_levels_rise_with_u(shift: float) -> None:
    levels = flow.shifted(torch.linspace(0, 1, 101, dtype=torch.float64), shift)
    assert (levels.diff() > 0).all()


@given(st.floats(0, 1), SHIFTS)
def test_a_shift_is_undone_by_its_inverse(u: float, shift: float) -> None:
    """Levels near 1 lose digits by cancellation of up to the shift, 100, times 1e-16."""
    there = flow.shifted(torch.tensor(u, dtype=torch.float64), shift)
    assert float(flow.shifted(there, 1 / shift)) == pytest.approx(u, abs=1e-12)


def test_a_shift_of_1_changes_nothing_and_one_of_5_lifts_the_middle_to_five_sixths() -> None:
    u = torch.tensor([0.1, 0.5, 0.9], dtype=torch.float64)
    assert torch.equal(flow.shifted(u, 1.0), u)
    assert float(flow.shifted(torch.tensor(0.5), 5.0)) == pytest.approx(5 / 6)


@given(st.integers(1, 300), SHIFTS)
def test_levels_of_a_sampler_fall_from_1_to_0(steps: int, shift: float) -> None:
    levels = flow.levels(steps, shift)
    assert levels.shape == (steps + 1,)
    assert levels.dtype == torch.float64
    assert (float(levels[0]), float(levels[-1])) == (pytest.approx(1), 0)
    assert (levels.diff() < 0).all()


def test_the_network_is_told_a_thousand_times_sigma_in_float32_and_sees_48_channels() -> None:
    """bfloat16 would round timesteps near 1000 by up to 2; the latent keeps its type."""
    seen: dict[str, Tensor] = {}

    def network(hidden: Tensor, timestep: Tensor, text: Tensor, image: None, reference: Tensor,
                return_dict: bool) -> tuple[Tensor]:  # fmt: skip
        seen.update(hidden=hidden, timestep=timestep, text=text, reference=reference)
        assert not return_dict
        return (hidden[:, :16] * 2,)

    x = torch.randn(2, 16, 3, 4, 5).bfloat16()
    inputs = denoiser.Inputs(torch.rand(2, 32, 3, 4, 5), torch.rand(2, 16, 4, 5), torch.rand(2, 512, 8), None)
    v = denoiser.velocity(network, x, torch.tensor([0.9993, 0.25], dtype=torch.float64), inputs)  # type: ignore[arg-type]
    assert torch.equal(v, 2 * x)
    assert seen["hidden"].shape == (2, 48, 3, 4, 5)
    assert seen["hidden"].dtype == torch.bfloat16
    assert torch.equal(seen["hidden"][:, 16:], inputs.channels.bfloat16())
    assert seen["timestep"].dtype == torch.float32
    assert seen["timestep"].tolist() == pytest.approx([999.3, 250.0])
    assert seen["reference"] is inputs.reference
