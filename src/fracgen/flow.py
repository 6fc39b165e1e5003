"""Flow matching as Wan writes it: x_sigma = (1 - sigma) x0 + sigma noise, and the network predicts noise - x0.

The paper's time is t = 1 - sigma and its velocity -v, so that the loss (Eq. 1) is the same. Shapes: latents x are
[B, ...], sigma is [B].
"""

import torch
from torch import Tensor

TIMESTEPS = 1000.0
"""The network is told TIMESTEPS * sigma."""


def expand(sigma: Tensor, x: Tensor) -> Tensor:
    """`sigma` [B] as [B, 1, ...], to be multiplied with `x` [B, ...]."""
    return sigma.reshape(-1, *[1] * (x.ndim - 1))


def shifted(u: Tensor, shift: float) -> Tensor:
    """Noise levels of uniform numbers `u` in [0, 1], any shape: shift u / (1 + (shift - 1) u).

    A shift above 1 draws more of the high noise levels, where the coarse motion is decided (Esser et al. 2024, Eq. 23).
    """
    return shift * u / (1 + (shift - 1) * u)


def noisy(x0: Tensor, noise: Tensor, sigma: Tensor) -> Tensor:
    """The latent [B, ...] at noise level `sigma` [B] between `x0` and `noise`, both [B, ...]."""
    s = expand(sigma, x0)
    return (1 - s) * x0 + s * noise


def velocity(x0: Tensor, noise: Tensor) -> Tensor:
    """What the network is to predict, noise - x0, [B, ...]."""
    return noise - x0


def clean(x: Tensor, v: Tensor, sigma: Tensor) -> Tensor:
    """The estimate of x0, [B, ...], from the noisy latent `x` and the predicted `v`, both [B, ...]: x - sigma v."""
    return x - expand(sigma, x) * v


def levels(steps: int, shift: float) -> Tensor:
    """Noise levels of a sampler with `steps` steps, (steps + 1,) float64, falling from 1 to 0."""
    return shifted(torch.linspace(1, 0, steps + 1, dtype=torch.float64), shift)
