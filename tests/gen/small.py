"""A transformer of a few thousand parameters, a forward pass and a training step, for tests."""

from typing import Any

import torch
from torch import Tensor

from fracgen.config.model import Lora, Model
from fracgen.model import FracTransformer, adapter, build, empty

STREAMS = ("rgb", "damage")
SIZES = {"layers": 2, "heads": 2, "head_dim": 16, "ffn_dim": 48, "text_dim": 12, "image_dim": 0}


def config(**changes: Any) -> Model:
    return Model(**{**SIZES, "lora": Lora(rank=4, alpha=4.0), **changes})


def plain(cfg: Model, device: str = "cpu", dtype: torch.dtype = torch.float32) -> FracTransformer:
    """The transformer of `cfg` for two streams, without adapters."""
    return empty(cfg, STREAMS) if device == "meta" else build(cfg, STREAMS, device, dtype)


def forward(transformer: FracTransformer, seed: int = 0) -> Tensor:
    """The output for two clips of 2 latent frames, two streams of 2 x 4 latents each."""
    generator = torch.Generator().manual_seed(seed)
    x = torch.randn(2, 48, 2, 4, 4, generator=generator)
    text = torch.randn(2, 6, SIZES["text_dim"], generator=generator)
    reference = torch.randn(2, 16, 4, 4, generator=generator)
    return transformer(x, torch.tensor([900.0, 300.0]), text, None, reference, return_dict=False)[0]


def train(transformer: FracTransformer, steps: int = 2, **settings: Any) -> None:
    """Optimiser steps towards output zero."""
    parameters = [p for p in transformer.parameters() if p.requires_grad]
    optimiser = torch.optim.AdamW(parameters, **{"lr": 1e-2, "weight_decay": 0.5, **settings})
    for step in range(steps):
        forward(transformer, step).square().mean().backward()
        optimiser.step()
        optimiser.zero_grad()


def gradients(transformer: FracTransformer) -> dict[str, Tensor]:
    """Gradients of the trained parameters after one backward pass."""
    transformer.zero_grad()
    forward(transformer).square().mean().backward()
    return {n: p.grad.clone() for n, p in transformer.named_parameters() if p.requires_grad and p.grad is not None}


def prepared(**changes: Any) -> FracTransformer:
    """A transformer with adapters, after a step, so that lora_B is not 0 and every gradient is alive."""
    cfg = config(**changes)
    transformer = plain(cfg)
    adapter.prepare(transformer, cfg)
    train(transformer, steps=1)
    return transformer


def equal(first: dict[str, Tensor], second: dict[str, Tensor]) -> bool:
    """Whether two dictionaries have the same tensors, bit for bit."""
    return first.keys() == second.keys() and all(torch.equal(first[n], second[n]) for n in first)
