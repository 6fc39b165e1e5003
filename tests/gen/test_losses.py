"""The losses in closed form on small tensors: flow matching by stream, and the constitutive regulariser (Eq. 8 to 10).

Tolerances: float64 rounding (1e-12) for closed forms in float64, 1e-6 in float32.
"""

import math

import pytest
import torch
from torch import Tensor

from fracgen import flow
from fracgen.conditioning import scalars
from fracgen.config.train import Loss
from fracgen.layout import DAMAGE, STRAIN, STREAMS, STRESS, join
from fracgen.losses import constitutive, flow_matching
from fracgen.losses.constitutive import Constitutive, lame, noise_weight
from fracsim.scene.condition import Condition


def latents(*, seed: int = 0, clips: int = 2) -> dict[str, Tensor]:
    """Random latents of the three streams of the loss, float64."""
    generator = torch.Generator().manual_seed(seed)
    return {
        name: torch.randn(clips, 16, 2, 3, 2, dtype=torch.float64, generator=generator).requires_grad_()
        for name in constitutive.STREAMS
    }


def conditions(*nu: float, E: float = 1e4) -> Tensor:
    """Conditions of clips with these Poisson's ratios, float64."""
    return torch.stack([torch.from_numpy(scalars(Condition(E=E, nu=n))).double() for n in nu])


def trained(cfg: Loss | None = None) -> Constitutive:
    """The loss with f and g away from zero, in float64."""
    loss = Constitutive(cfg or Loss()).double()
    generator = torch.Generator().manual_seed(1)
    for parameter in loss.parameters():
        parameter.data += 0.3 * torch.randn(parameter.shape, dtype=torch.float64, generator=generator)
    return loss


SIGMA = torch.tensor([0.2, 0.7], dtype=torch.float64)


# Flow matching


def test_the_error_of_a_stream_is_the_mean_square_of_its_part_of_the_velocity() -> None:
    """Stream k is off by k + 1 everywhere, in whatever order it is named."""
    target = join({name: torch.zeros(1, 16, 2, 2, 4) for name in STREAMS})
    predicted = join({name: torch.full((1, 16, 2, 2, 4), k + 1.0) for k, name in enumerate(STREAMS)})
    errors = flow_matching.per_stream(predicted, target, tuple(reversed(STREAMS)))
    assert errors.tolist() == [[1.0, 4.0, 9.0, 16.0, 25.0]]


def test_the_loss_with_equal_weights_is_the_mean_square_of_the_joint_latent() -> None:
    predicted, target = torch.randn(2, 3, 16, 2, 10, 4).unbind(0)
    errors = flow_matching.per_stream(predicted, target, STREAMS)
    loss = flow_matching.weighted(errors, flow_matching.weights([1.0] * 5, STREAMS))
    torch.testing.assert_close(loss, (predicted - target).square().mean(dim=(1, 2, 3, 4)), rtol=1e-6, atol=0)


def test_weights_are_shares_of_the_streams_of_the_stage() -> None:
    assert flow_matching.weights([1, 2, 0, 3, 4], ["damage", "rgb"]) == [0.2, 0.8]
    assert flow_matching.weights([5, 0, 0, 0, 0], ["rgb"]) == [1.0]
    with pytest.raises(ValueError, match=r"loss.map_weights=\[0, 1, 1, 1, 1\] leaves nothing to learn.*rgb"):
        flow_matching.weights([0, 1, 1, 1, 1], ["rgb"])


def test_bf16_velocities_are_compared_in_fp32() -> None:
    """1 + 1/128 is a bf16 number whose square, 1.0156860..., is none."""
    predicted = torch.full((1, 16, 1, 2, 2), 1 + 1 / 128, dtype=torch.bfloat16)
    errors = flow_matching.per_stream(predicted, torch.zeros_like(predicted), ["rgb"])
    assert errors.dtype == torch.float32
    assert errors.item() == pytest.approx((1 + 1 / 128) ** 2, rel=1e-6)


def test_the_estimate_of_x0_is_exact_for_the_true_velocity_and_off_by_sigma_times_its_error() -> None:
    x0, noise, error = torch.randn(3, 2, 16, 2, 2, 2, dtype=torch.float64).unbind(0)
    x, v = flow.noisy(x0, noise, SIGMA), flow.velocity(x0, noise)
    torch.testing.assert_close(flow.clean(x, v, SIGMA), x0, rtol=1e-12, atol=1e-12)
    off = flow.clean(x, v + error, SIGMA) - x0
    torch.testing.assert_close(off, -flow.expand(SIGMA, error) * error, rtol=1e-12, atol=1e-12)


# Lame parameters and w(t)


def test_lame_parameters_over_the_p_wave_modulus_sum_to_one_and_are_finite_at_half() -> None:
    first, second = lame(conditions(0.1, 0.25, 0.45, 0.5), "pwave")
    torch.testing.assert_close(first, torch.tensor([1 / 9, 1 / 3, 9 / 11, 1], dtype=torch.float64), rtol=1e-6, atol=0)
    torch.testing.assert_close(first + second, torch.ones(4, dtype=torch.float64), rtol=1e-6, atol=1e-7)


def test_lame_parameters_over_E_and_in_pascal() -> None:
    """E = 2e4 Pa, nu = 0.25: lambda_L = 8e3 Pa, mu = 8e3 Pa. 1e-5: conditions are rounded to float32 in log10 E."""
    first, second = lame(conditions(0.25, E=2e4), "E")
    assert (first.item(), second.item()) == (pytest.approx(0.4, rel=1e-5), pytest.approx(0.8, rel=1e-5))
    first, second = lame(conditions(0.25, E=2e4), "raw")
    assert (first.item(), second.item()) == (pytest.approx(8e3, rel=1e-5), pytest.approx(1.6e4, rel=1e-5))


@pytest.mark.parametrize("scale", ["E", "raw"])
def test_an_incompressible_clip_is_refused_where_lambda_is_infinite(scale: str) -> None:
    with pytest.raises(ValueError, match=rf"loss.lame={scale} needs nu < 0.5.*nu=0.5.*loss.lame=pwave"):
        lame(conditions(0.3, 0.5), scale)


def test_the_weight_grows_as_noise_vanishes() -> None:
    sigma = torch.tensor([0.0, 0.5, 1.0])
    assert noise_weight(sigma, "clean").tolist() == [1.0, 0.25, 0.0]
    assert noise_weight(sigma, "ratio").tolist() == [1.0, 0.5, 0.0]
    assert noise_weight(sigma, "none").tolist() == [1.0, 1.0, 1.0]


# The constitutive regulariser


def test_the_target_is_zero_at_the_start() -> None:
    """Then the loss is w times the mean square of the stress latent."""
    z, loss = latents(), Constitutive(Loss()).double()
    assert not loss.target(z[STRAIN], loss.gate(z[DAMAGE]), conditions(0.2, 0.4)).any()
    expected = (1 - SIGMA) ** 2 * z[STRESS].square().mean(dim=(1, 2, 3, 4))
    torch.testing.assert_close(loss(z, conditions(0.2, 0.4), SIGMA).loss, expected, rtol=1e-12, atol=0)


def test_the_loss_in_closed_form_with_diagonal_maps() -> None:
    """f multiplies by 2 and adds 1, g multiplies by -3; damage latent 0 opens the gate half."""
    loss = Constitutive(Loss()).double()
    eye = torch.eye(16, dtype=torch.float64).reshape(16, 16, 1, 1, 1)
    loss.f.weight.data, loss.g.weight.data = 2 * eye, -3 * eye
    assert loss.f.bias is not None
    loss.f.bias.data.fill_(1.0)
    shape = (1, 16, 2, 3, 2)
    z = {name: torch.full(shape, v, dtype=torch.float64) for name, v in {STRAIN: 0.6, STRESS: 0.4, DAMAGE: 0.0}.items()}
    terms = loss(z, conditions(0.25), SIGMA[:1])
    target = 0.5 * (1 / 3 * (2 * 0.6 + 1) + 2 / 3 * (-3 * 0.6))  # nu = 0.25: 1/3 and 2/3
    assert terms.loss.item() == pytest.approx(0.8**2 * (0.4 - target) ** 2, rel=1e-6)
    assert (terms.gate_mean.item(), terms.gate_std.item()) == (0.5, 0.0)


@pytest.mark.parametrize("gate", ["sigmoid", "affine"])
@pytest.mark.parametrize("scale", ["pwave", "E"])
@pytest.mark.parametrize("weight", ["clean", "ratio", "none"])
def test_gradients_agree_with_finite_differences(gate: str, scale: str, weight: str) -> None:
    """Of all three latents and of all parameters, in float64; gradcheck's own bounds."""
    loss = trained(Loss(gate=gate, lame=scale, weight=weight))
    names = [name for name, _ in loss.named_parameters()]
    generator = torch.Generator().manual_seed(2)
    z = [torch.randn(1, 16, 1, 1, 2, dtype=torch.float64, generator=generator).requires_grad_() for _ in range(3)]

    def value(*inputs: Tensor) -> Tensor:
        given = dict(zip(constitutive.STREAMS, inputs[:3], strict=True))
        parameters = dict(zip(names, inputs[3:], strict=True))
        out = torch.func.functional_call(loss, parameters, (given, conditions(0.3), SIGMA[:1]))
        assert isinstance(out, constitutive.Terms)
        return out.loss.sum()

    small = [p.detach().clone().requires_grad_() for p in loss.parameters()]
    assert torch.autograd.gradcheck(value, (*z, *small), fast_mode=True)


def test_gradients_by_hand() -> None:
    """With r = stress - (1 - s) T and n values a clip: 2 w r / n for the stress, 2 w r s (1 - s) T / n for the damage,
    -2 w (1 - s) (lambda f + 2 mu g)^T r / n for the strain."""
    loss, z, numbers = trained(), latents(), conditions(0.2, 0.4)
    loss(z, numbers, SIGMA).loss.sum().backward()
    first, second = (flow.expand(v, z[STRAIN]) for v in lame(numbers, "pwave"))
    gate = torch.sigmoid(z[DAMAGE])
    free = first * loss.f(z[STRAIN]) + second * loss.g(z[STRAIN])
    factor = 2 * flow.expand((1 - SIGMA) ** 2, free) * (z[STRESS] - (1 - gate) * free) / z[STRESS][0].numel()
    through = factor * (1 - gate)
    back = [torch.einsum("oi,bothw->bithw", m.weight[:, :, 0, 0, 0], through * s)
            for m, s in ((loss.f, first), (loss.g, second))]  # fmt: skip
    expected = {STRESS: factor, DAMAGE: factor * gate * (1 - gate) * free, STRAIN: -(back[0] + back[1])}
    for name in constitutive.STREAMS:
        assert z[name].grad is not None
        torch.testing.assert_close(z[name].grad, expected[name].detach(), rtol=1e-10, atol=1e-14)


def test_f_and_g_leave_zero_at_the_first_step_and_then_gradients_reach_all_latents() -> None:
    """At the start the target is 0, so that strain and damage have no gradient yet, but f and g have one."""
    loss, z = Constitutive(Loss()).double(), latents()
    loss(z, conditions(0.2, 0.4), SIGMA).loss.sum().backward()
    for parameter in loss.parameters():
        assert parameter.grad is not None
        assert parameter.grad.abs().max() > 0
        parameter.data -= 0.1 * parameter.grad
    for tensor in z.values():
        tensor.grad = None
    loss(z, conditions(0.2, 0.4), SIGMA).loss.sum().backward()
    for tensor in z.values():
        assert tensor.grad is not None
        assert tensor.grad.abs().max() > 0


def test_detached_latents_get_no_gradient_and_the_maps_keep_theirs() -> None:
    loss, z = trained(Loss(gate="affine")), latents()
    loss(z, conditions(0.2, 0.4), SIGMA, detach=True).loss.sum().backward()
    assert all(tensor.grad is None for tensor in z.values())
    assert all(p.grad is not None and p.grad.abs().max() > 0 for p in loss.parameters())


def test_full_damage_makes_the_target_zero() -> None:
    loss, z = trained(), latents()
    z[DAMAGE] = torch.full_like(z[DAMAGE], 50.0)
    expected = (1 - SIGMA) ** 2 * z[STRESS].square().mean(dim=(1, 2, 3, 4))
    torch.testing.assert_close(loss(z, conditions(0.2, 0.4), SIGMA).loss, expected, rtol=1e-12, atol=0)


def test_a_batch_of_two_is_two_batches_of_one() -> None:
    loss, z, numbers = trained(), latents(), conditions(0.2, 0.4)
    both = loss(z, numbers, SIGMA).loss
    for k in range(2):
        one = loss({n: t[k : k + 1] for n, t in z.items()}, numbers[k : k + 1], SIGMA[k : k + 1]).loss
        assert math.isclose(one.item(), both[k].item(), rel_tol=1e-12)


def test_the_maps_have_the_parameters_of_the_paper() -> None:
    """Two 1 x 1 x 1 convolutions over 16 channels with bias, and with the affine gate 32 more."""
    assert sum(p.numel() for p in Constitutive(Loss()).parameters()) == 2 * (16 * 16 + 16)
    assert sum(p.numel() for p in Constitutive(Loss(gate="affine")).parameters()) == 2 * (16 * 16 + 16) + 32
