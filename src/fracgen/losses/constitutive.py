"""The latent constitutive regulariser (Eq. 8 to 10 of the paper).

It ties the estimated stress latent to (1 - gate) * (lambda_L f(strain) + 2 mu g(strain)), where f and g are learned
1 x 1 x 1 convolutions and the gate comes from the damage latent. The strain map is a norm and the stress map von Mises,
so the term with lambda_L has no physical basis of its own; it is kept as the paper writes it.
Shapes: latents are [B, 16, T, H, W].
"""

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor, nn

from fracgen.conditioning import LOG_E, NU, SCALARS
from fracgen.config.train import Loss
from fracgen.flow import expand
from fracgen.layout import CHANNELS, DAMAGE, STRAIN, STRESS

STREAMS = (STRAIN, STRESS, DAMAGE)
"""Streams that the loss needs."""


class Terms(NamedTuple):
    """The loss of each clip, [B], and mean and standard deviation of its gate, [B], without gradient."""

    loss: Tensor
    gate_mean: Tensor
    gate_std: Tensor


class Constitutive(nn.Module):
    """The maps f and g, and the loss that they define."""

    def __init__(self, cfg: Loss) -> None:
        super().__init__()
        self.cfg = cfg
        self.f = _zero_map()
        self.g = _zero_map()
        affine = cfg.gate == "affine"
        self.gate_scale = nn.Parameter(torch.ones(CHANNELS, 1, 1, 1)) if affine else None
        self.gate_bias = nn.Parameter(torch.zeros(CHANNELS, 1, 1, 1)) if affine else None

    def gate(self, damage: Tensor) -> Tensor:
        """Share of the stress that damage takes away, in (0, 1), [B, 16, T, H, W], of a damage latent of that shape."""
        if self.gate_scale is not None and self.gate_bias is not None:
            damage = self.gate_scale * damage + self.gate_bias
        return damage.sigmoid()

    def target(self, strain: Tensor, gate: Tensor, scalars: Tensor) -> Tensor:
        """The stress latent of Eq. 8 after the gate, [B, 16, T, H, W]; `scalars` are [B, 6]."""
        first, second = lame(scalars, self.cfg.lame)
        free: Tensor = expand(first, strain) * self.f(strain) + expand(second, strain) * self.g(strain)
        return (1 - gate) * free

    def forward(self, clean: Mapping[str, Tensor], scalars: Tensor, sigma: Tensor, detach: bool = False) -> Terms:
        """The loss of each clip from estimates of the clean latents by stream, [B, 16, T, H, W] each.

        `scalars` are the conditions [B, 6], `sigma` the noise levels [B]; `detach` keeps the gradient from the latents,
        so that only f, g and the gate learn.
        """
        strain, stress, damage = (clean[name].detach() if detach else clean[name] for name in STREAMS)
        gate = self.gate(damage)
        squared = (stress - self.target(strain, gate, scalars)).square().mean(dim=(1, 2, 3, 4))
        shown = gate.detach().flatten(1)
        return Terms(noise_weight(sigma, self.cfg.weight) * squared, shown.mean(1), shown.std(1))


def _zero_map() -> nn.Conv3d:
    """A 1 x 1 x 1 convolution that gives zeros; its bias is there since a black map is not the latent 0."""
    layer = nn.Conv3d(CHANNELS, CHANNELS, 1)
    nn.init.zeros_(layer.weight)
    assert layer.bias is not None
    nn.init.zeros_(layer.bias)
    return layer


def lame(scalars: Tensor, scale: str) -> tuple[Tensor, Tensor]:
    """lambda_L and 2 mu of clips with conditions `scalars` [B, 6], each [B].

    `scale`: "pwave" divides them by lambda_L + 2 mu, which gives nu / (1 - nu) and (1 - 2 nu) / (1 - nu), finite up to
    nu = 0.5; "E" divides them by E; "raw" leaves them in Pa. Raises ValueError for nu = 0.5 unless with "pwave".
    """
    columns = dict(zip(SCALARS, scalars.unbind(1), strict=True))
    nu = NU[0] + NU[1] * columns["nu"]
    if scale == "pwave":
        return nu / (1 - nu), (1 - 2 * nu) / (1 - nu)
    if bool((nu >= NEARLY_INCOMPRESSIBLE).any()):
        raise ValueError(f"loss.lame={scale} needs nu < 0.5, and a clip has nu={float(nu.max()):g}, where lambda_L is "
                         "infinite: set loss.lame=pwave.")  # fmt: skip
    E = 10 ** (LOG_E[0] + LOG_E[1] * columns["E"]) if scale == "raw" else torch.ones_like(nu)
    return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (1 + nu)


NEARLY_INCOMPRESSIBLE = 0.5 - 1e-5
"""Largest nu of which float32 keeps 1 - 2 nu to about a percent."""


def noise_weight(sigma: Tensor, kind: str) -> Tensor:
    """w(t) of noise levels [B], [B]: estimates from less noise count more."""
    if kind == "none":
        return torch.ones_like(sigma)
    clean = (1 - sigma) ** 2
    return clean if kind == "clean" else clean / (clean + sigma**2)
