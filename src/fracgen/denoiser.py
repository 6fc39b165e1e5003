"""One call of the network: the noisy joint latent and everything it is conditioned on, to the predicted velocity."""

from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from fracgen.flow import TIMESTEPS


class Inputs(NamedTuple):
    """What the network sees beside the noisy latent. B clips, T latent frames, S H x W joint rows and columns."""

    channels: Tensor
    """Force, material and fracture, [B, 32, T, S H, W]."""
    reference: Tensor
    """Latent of the object's picture above zeros, [B, 16, S H, W]."""
    text: Tensor
    """Embedding of the caption, zeros after its end, [B, 512, D]."""
    image: Tensor | None
    """CLIP embedding of the object's picture, [B, 257, 1280]; None for a network without that branch."""

    def of(self, clips: Tensor) -> "Inputs":
        """Those of some clips, whose numbers are `clips`, [B] int64."""
        return Inputs(self.channels[clips], self.reference[clips], self.text[clips],
                      None if self.image is None else self.image[clips])  # fmt: skip


class Network(Protocol):
    """What `fracgen.model.transformer.FracTransformer` and its wrappers are to the rest of the package."""

    def __call__(
        self,
        hidden_states: Tensor,
        timestep: Tensor,
        encoder_hidden_states: Tensor,
        encoder_hidden_states_image: Tensor | None = None,
        reference: Tensor | None = None,
        return_dict: bool = True,
    ) -> tuple[Tensor]:
        """The predicted velocity, [B, 16, T, S H, W], as the only entry; shapes as in `Inputs`."""
        ...


def velocity(network: Network, x: Tensor, sigma: Tensor, inputs: Inputs) -> Tensor:
    """The predicted noise - x0, [B, 16, T, S H, W], at `x` of that shape and noise level `sigma` [B] float32."""
    hidden = torch.cat([x, inputs.channels.to(x)], dim=1)
    (out,) = network(hidden, TIMESTEPS * sigma.float(), inputs.text, inputs.image, inputs.reference, return_dict=False)
    return out
