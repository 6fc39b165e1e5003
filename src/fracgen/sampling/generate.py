"""Joint latents from noise: what the sampling command, the videos of the validation and the benchmark call.

Shapes: B clips, T latent frames, S H x W rows and columns of the joint latent.
"""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from fracgen import draws, layout
from fracgen.denoiser import Inputs, Network, velocity
from fracgen.sampling import solvers

PASSES = ("sequential", "batched")
"""How the two passes of guidance run: one after the other, or as one batch (faster, twice the memory)."""
Advance = Callable[[], None]
"""Called after each evaluation of the velocity."""


def initial(inputs: Inputs, seed: int, keys: Sequence[int | str]) -> Tensor:
    """The noise to start from, [B, 16, T, S H, W] float32 on the CPU; a clip's depends on `seed` and its key only."""
    clip = (layout.CHANNELS, *inputs.channels.shape[2:])
    assert len(keys) == len(inputs.channels), (keys, inputs.channels.shape)
    return torch.stack([draws.normal(clip, seed, "sample", key) for key in keys])


@torch.no_grad()
def sample(
    network: Network,
    x: Tensor,
    inputs: Inputs,
    levels: Tensor,
    *,
    solver: str = "euler",
    guidance: float = 1.0,
    empty: Tensor | None = None,
    passes: str = "sequential",
    first: Tensor | None = None,
    advance: Advance | None = None,
) -> Tensor:
    """The joint latent [B, 16, T, S H, W] that `network` makes of the noise `x` of that shape.

    `levels` are those of `flow.levels`, [steps + 1]. With a `guidance` g other than 1 the velocity is that without
    caption plus g times the difference that the caption makes (Ho and Salimans 2022; text only, as Wan does), where
    `empty` is the embedding of the empty caption, [1, 512, D]; at 1 there is no second pass. `first`, [B, 16, H, W],
    is put in place of the first latent frame of colour. The solver computes in the type of `x` and on its device, the
    network in its own type. Raises ValueError for an unknown solver, or guidance without `empty`.
    """
    field = _guided(network, _each(inputs, lambda tensor: tensor.to(x)), guidance, empty, passes)
    if first is not None:
        field = _anchored(field, x, first.to(x))
    if advance is not None:
        field = _counted(field, advance)
    return solvers.load(solver).solve(field, x, levels)


def _each(inputs: Inputs, change: Callable[[Tensor], Tensor]) -> Inputs:
    """The inputs, each changed."""
    image = None if inputs.image is None else change(inputs.image)
    return Inputs(change(inputs.channels), change(inputs.reference), change(inputs.text), image)


def _guided(network: Network, inputs: Inputs, guidance: float, empty: Tensor | None, passes: str) -> solvers.Field:
    """The velocity as a function of the latent, any shape, and the noise level."""
    assert passes in PASSES, passes
    if guidance == 1:
        return lambda x, sigma: _evaluate(network, x, sigma, inputs)
    if empty is None:
        raise ValueError(f"sampler.guidance={guidance:g} needs the embedding of the empty caption, and there is none: "
                         "set sampler.guidance=1.")  # fmt: skip
    without = inputs._replace(text=empty.to(inputs.text).expand_as(inputs.text))
    return (_batched if passes == "batched" else _sequential)(network, inputs, without, guidance)


def _sequential(network: Network, inputs: Inputs, without: Inputs, guidance: float) -> solvers.Field:
    """The guided velocity by two calls."""

    def field(x: Tensor, sigma: float) -> Tensor:
        v = _evaluate(network, x, sigma, without)
        return v + guidance * (_evaluate(network, x, sigma, inputs) - v)

    return field


def _batched(network: Network, inputs: Inputs, without: Inputs, guidance: float) -> solvers.Field:
    """The guided velocity by one call of twice the batch."""
    both = _each(inputs, lambda tensor: torch.cat([tensor, tensor]))._replace(
        text=torch.cat([without.text, inputs.text])
    )

    def field(x: Tensor, sigma: float) -> Tensor:
        v, with_text = _evaluate(network, torch.cat([x, x]), sigma, both).chunk(2)
        return v + guidance * (with_text - v)

    return field


def _evaluate(network: Network, x: Tensor, sigma: float, inputs: Inputs) -> Tensor:
    """The velocity [B, 16, T, S H, W] in the type of `x`."""
    level = torch.full((len(x),), sigma, dtype=torch.float32, device=x.device)
    return velocity(network, x, level, inputs).to(x.dtype)


def _anchored(field: solvers.Field, noise: Tensor, first: Tensor) -> solvers.Field:
    """`field` whose first latent frame of colour moves straight from the noise to `first`, [B, 16, H, W]."""
    rows = first.shape[-2]
    target = noise[:, :, 0, :rows] - first

    def anchored(x: Tensor, sigma: float) -> Tensor:
        v = field(x, sigma).clone()
        v[:, :, 0, :rows] = target
        return v

    return anchored


def _counted(field: solvers.Field, advance: Advance) -> solvers.Field:
    """`field` that calls `advance` after each evaluation."""

    def counted(x: Tensor, sigma: float) -> Tensor:
        v = field(x, sigma)
        advance()
        return v

    return counted
