"""The transformer of a stage, with its base weights, its adapters, and as it is to run on a device."""

from typing import Any

import torch

from fracgen import model
from fracgen.config.train import TrainConfig
from fracgen.memory import setup
from fracgen.model import FracTransformer, adapter


def build(cfg: TrainConfig, streams: tuple[str, ...]) -> FracTransformer:
    """The transformer on the CPU, with what is trained in float32; raises ValueError for what cannot be used."""
    kind = torch.float32 if cfg.trainer.base_dtype == "float32" else torch.bfloat16
    transformer: Any = model.build(cfg.model, streams, "cpu", kind)
    adapter.prepare(transformer, cfg.model)
    out: FracTransformer = transformer.train()
    return out


def settle(transformer: Any, cfg: TrainConfig, device: torch.device, tokens: int) -> None:
    """Prepare a transformer that is still on the CPU for a device and for clips of so many tokens; raises ValueError
    for what does not work there."""
    setup.apply(transformer, cfg.trainer, device.type, tokens)
