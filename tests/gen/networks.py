"""A transformer of a few thousand parameters, a forward pass and a training step, for tests."""

from typing import Any

import torch
from diffusers import WanTransformer3DModel
from torch import Tensor

from fracgen.config.model import Lora, Model

SIZES = {"layers": 2, "heads": 2, "head_dim": 16, "ffn_dim": 48, "text_dim": 12, "image_dim": 0}


def config(**changes: Any) -> Model:
    return Model(**{**SIZES, "lora": Lora(rank=4, alpha=4.0), **changes})


def plain(cfg: Model, device: str = "cpu", dtype: torch.dtype = torch.float32) -> WanTransformer3DModel:
    torch.manual_seed(cfg.seed)
    with torch.device(device):
        out = WanTransformer3DModel(
            num_attention_heads=cfg.heads, attention_head_dim=cfg.head_dim, in_channels=48, out_channels=16,
            text_dim=cfg.text_dim, ffn_dim=cfg.ffn_dim, num_layers=cfg.layers,
            image_dim=cfg.image_dim or None, added_kv_proj_dim=cfg.heads * cfg.head_dim if cfg.image_dim else None,
        )  # fmt: skip
    return out.to(dtype)


def forward(transformer: WanTransformer3DModel, seed: int = 0) -> Tensor:
    """The output for two clips of 2 latent frames, 4 x 4 latents."""
    generator = torch.Generator().manual_seed(seed)
    x = torch.randn(2, 48, 2, 4, 4, generator=generator)
    text = torch.randn(2, 6, SIZES["text_dim"], generator=generator)
    return transformer(x, torch.tensor([900.0, 300.0]), text, return_dict=False)[0]


def train(transformer: WanTransformer3DModel, steps: int = 2, **settings: Any) -> None:
    """Optimiser steps towards output zero."""
    parameters = [p for p in transformer.parameters() if p.requires_grad]
    optimiser = torch.optim.AdamW(parameters, **{"lr": 1e-2, "weight_decay": 0.5, **settings})
    for step in range(steps):
        forward(transformer, step).square().mean().backward()
        optimiser.step()
        optimiser.zero_grad()


def gradients(transformer: WanTransformer3DModel) -> dict[str, Tensor]:
    """Gradients of the trained parameters after one backward pass."""
    transformer.zero_grad()
    forward(transformer).square().mean().backward()
    return {n: p.grad.clone() for n, p in transformer.named_parameters() if p.requires_grad and p.grad is not None}
