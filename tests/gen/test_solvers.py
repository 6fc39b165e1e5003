"""Solvers: orders of convergence where the solution is known; guidance, its cost, and what a batch may not change.

For data that are normal with mean m and standard deviation s, the velocity E[noise - x0 | x] is linear in x, and
a latent that starts as z at sigma = 1 arrives at m + s z.
"""

import math

import pytest
import torch
from torch import Tensor

from fracgen import draws, flow
from fracgen.denoiser import Inputs
from fracgen.sampling import generate, solvers

MEAN, STD = 0.7, 0.5


def gaussian(x: Tensor, sigma: float) -> Tensor:
    """The velocity of normal data: E[noise | x] - E[x0 | x], any shape."""
    a = 1 - sigma
    variance = (a * STD) ** 2 + sigma**2
    rest = x - a * MEAN
    return sigma / variance * rest - (MEAN + a * STD**2 / variance * rest)


def error(solver: str, steps: int, shift: float = 3.0) -> float:
    """Root mean square error of the end point in units of the standard deviation."""
    z = draws.normal((4, 500), "start").double()
    x = solvers.load(solver).solve(gaussian, z, flow.levels(steps, shift))
    return float((x - MEAN - STD * z).square().mean().sqrt() / STD)


@pytest.mark.parametrize("shift", [1.0, 5.0])
def test_euler_halves_its_error_when_steps_double(shift: float) -> None:
    """Order 1: the ratio tends to 2, and the next term of the error is 1/n of it, here with a factor below 10."""
    for steps in (100, 200):
        assert error("euler", steps, shift) / error("euler", 2 * steps, shift) == pytest.approx(2, rel=10 / steps)


@pytest.mark.parametrize(("shift", "steps"), [(1.0, 100), (3.0, 400)])
def test_unipc_quarters_its_error_when_steps_double(shift: float, steps: int) -> None:
    """Order 2: the ratio tends to 4; what is left of it at these steps is below an eighth."""
    assert error("unipc", steps, shift) / error("unipc", 2 * steps, shift) == pytest.approx(4, rel=1 / 8)


@pytest.mark.parametrize("shift", [1.0, 3.0, 5.0])
def test_unipc_is_better_than_euler_with_five_times_the_steps(shift: float) -> None:
    assert error("unipc", 40, shift) < error("euler", 200, shift)


@pytest.mark.parametrize("solver", ["euler", "unipc"])
@pytest.mark.parametrize("steps", [1, 2, 7])
def test_a_straight_flow_is_solved_exactly_in_any_number_of_steps(solver: str, steps: int) -> None:
    """With one datum the velocity is constant; UniPC has float32 levels and begins at 1 - 1e-6."""
    z, x0 = draws.normal((2, 50), "z").double(), draws.normal((2, 50), "x0").double()
    x = solvers.load(solver).solve(lambda x, sigma: z - x0, z, flow.levels(steps, 5.0))
    assert torch.allclose(x, x0, rtol=0, atol=1e-12 if solver == "euler" else 1e-5)


@pytest.mark.parametrize("solver", ["euler", "unipc"])
def test_levels_are_visited_once_each_also_where_timesteps_round_alike(solver: str) -> None:
    """With a shift of 5 the first of 400 levels are 0.0005 apart: half of a timestep."""
    seen: list[float] = []
    levels = flow.levels(400, 5.0)
    solvers.load(solver).solve(lambda x, sigma: (seen.append(sigma), 0 * x)[1], torch.zeros(1, 3), levels)
    assert seen == pytest.approx(levels[:-1].tolist(), abs=2e-6)


def test_an_unknown_solver_is_named_with_those_there_are() -> None:
    with pytest.raises(ValueError, match=r"sampler\.solver=unipcc is not known: .*euler, unipc.* Did you mean unipc"):
        solvers.load("unipcc")


class Linear:
    """A network whose velocity depends on the caption's embedding and counts its calls."""

    def __init__(self) -> None:
        self.batches: list[int] = []

    def __call__(
        self,
        hidden_states: Tensor,
        timestep: Tensor,
        encoder_hidden_states: Tensor,
        encoder_hidden_states_image: Tensor | None = None,
        reference: Tensor | None = None,
        return_dict: bool = True,
    ) -> tuple[Tensor]:
        assert reference is not None
        self.batches.append(len(hidden_states))
        shift = encoder_hidden_states.mean(dim=(1, 2)) + timestep / flow.TIMESTEPS
        return (hidden_states[:, :16] * 0.3 + flow.expand(shift, hidden_states) + reference.mean(),)


def inputs(clips: int = 2, streams: int = 2) -> Inputs:
    return Inputs(
        channels=torch.zeros(clips, 32, 2, 4 * streams, 6),
        reference=torch.zeros(clips, 16, 4 * streams, 6),
        text=draws.normal((clips, 512, 3), "text") + torch.arange(1.0, clips + 1)[:, None, None],
        image=None,
    )


def test_without_guidance_the_network_is_called_once_a_step() -> None:
    network, given = Linear(), inputs()
    generate.sample(network, generate.initial(given, 0, [0, 1]), given, flow.levels(5, 5.0), guidance=1.0)
    assert network.batches == [2] * 5


@pytest.mark.parametrize(("passes", "calls"), [("sequential", [2] * 10), ("batched", [4] * 5)])
def test_guidance_takes_a_second_pass(passes: str, calls: list[int]) -> None:
    network, given = Linear(), inputs()
    generate.sample(network, generate.initial(given, 0, [0, 1]), given, flow.levels(5, 5.0), guidance=3.0,
                    empty=torch.zeros(1, 512, 3), passes=passes)  # fmt: skip
    assert network.batches == calls


@pytest.mark.parametrize("passes", generate.PASSES)
def test_guidance_extrapolates_from_the_empty_caption(passes: str) -> None:
    """This network's velocity is affine in the embedding: guidance g on text c equals the text e + g (c - e)."""
    given, empty = inputs(), draws.normal((1, 512, 3), "empty")
    x, levels = generate.initial(given, 0, [0, 1]), flow.levels(4, 5.0)
    guided = generate.sample(Linear(), x, given, levels, guidance=2.5, empty=empty, passes=passes)
    direct = generate.sample(Linear(), x, given._replace(text=empty + 2.5 * (given.text - empty)), levels)
    assert torch.allclose(guided, direct, rtol=0, atol=1e-5)  # float32 means over 1536 numbers of size 3


def test_guidance_without_the_embedding_of_the_empty_caption_is_refused() -> None:
    given = inputs()
    with pytest.raises(ValueError, match=r"sampler\.guidance=3 needs the embedding of the empty caption"):
        generate.sample(Linear(), generate.initial(given, 0, [0, 1]), given, flow.levels(4, 5.0), guidance=3.0)


def test_noise_belongs_to_a_clip_not_to_its_batch() -> None:
    both = generate.initial(inputs(2), 7, ["a", "b"])
    assert torch.equal(both[1:], generate.initial(inputs(1), 7, ["b"]))
    assert not torch.equal(both[0], both[1])
    assert not torch.equal(both, generate.initial(inputs(2), 8, ["a", "b"]))


@pytest.mark.parametrize("solver", ["euler", "unipc"])
def test_the_first_latent_frame_of_colour_can_be_given(solver: str) -> None:
    """It arrives there from any noise, and all else is as without: this network mixes no frames and no rows."""
    given, first = inputs(), draws.normal((2, 16, 4, 6), "first")
    x, levels = generate.initial(given, 0, [0, 1]), flow.levels(4, 5.0)
    free = generate.sample(Linear(), x, given, levels, solver=solver)
    held = generate.sample(Linear(), x, given, levels, solver=solver, first=first)
    assert torch.allclose(held[:, :, 0, :4], first, rtol=0, atol=1e-5)
    held[:, :, 0, :4] = free[:, :, 0, :4]
    assert torch.equal(held, free)


def test_progress_is_told_after_each_evaluation() -> None:
    ticks: list[int] = []
    given = inputs()
    generate.sample(Linear(), generate.initial(given, 0, [0, 1]), given, flow.levels(6, 5.0),
                    advance=lambda: ticks.append(1))  # fmt: skip
    assert len(ticks) == 6


def test_levels_of_a_sampler_are_those_of_training() -> None:
    """shift u / (1 + (shift - 1) u) at u = 1, 3/4, 1/2, 1/4, 0."""
    assert flow.levels(4, 5.0).tolist() == pytest.approx([1, 15 / 16, 5 / 6, 5 / 8, 0])
    assert math.isclose(flow.levels(3, 1.0)[1], 2 / 3)
