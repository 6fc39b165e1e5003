"""A small transformer and its inputs, for the tests of the model."""

from typing import Any

import torch
from torch import Tensor

from fracgen.config.model import Model

TEXT, IMAGE = 16, 32
"""Channels of the embeddings."""


def small(**changes: Any) -> Model:
    """A transformer of two blocks and 48 channels, whose heads have 8 channels for each of time, row and column."""
    sizes = {"heads": 2, "head_dim": 24, "ffn_dim": 64, "layers": 2, "text_dim": TEXT, "image_dim": IMAGE}
    return Model(**(sizes | changes))


def inputs(streams: int = 1, batch: int = 2, image: bool = True, seed: int = 0) -> dict[str, Tensor | None]:
    """Random arguments of its forward pass: 3 latent frames, 4 x 6 latent rows and columns a stream."""
    g = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(batch, *shape, generator=g)

    return {
        "hidden_states": normal(48, 3, 4 * streams, 6),
        "timestep": torch.linspace(813.7, 200.3, batch),
        "encoder_hidden_states": normal(512, TEXT),
        "encoder_hidden_states_image": normal(257, IMAGE) if image else None,
        "reference": normal(16, 4 * streams, 6),
    }


def run(network: Any, call: dict[str, Tensor | None], **changes: Any) -> Tensor:
    """The predicted velocity without gradients; `changes` replace arguments."""
    with torch.no_grad():
        (out,) = network(**(call | changes), return_dict=False)
    return out
