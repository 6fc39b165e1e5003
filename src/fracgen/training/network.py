"""The transformer of a stage, with its base weights, its adapters, and as it is to run on a device."""

from typing import Any

import torch

from fracgen import model
from fracgen.config.train import TrainConfig
from fracgen.memory import attention, checkpointing, compiling, offload, parallel, quantise
from fracgen.model import FracTransformer, adapter


def build(cfg: TrainConfig, streams: tuple[str, ...]) -> FracTransformer:
    """The transformer on the CPU, with what is trained in float32; raises ValueError for what cannot be used.

    Weights of offloaded blocks then never reach the device in one piece.
    """
    t = cfg.trainer
    kind = torch.float32 if t.base_dtype == "float32" else torch.bfloat16
    transformer: Any = model.build(cfg.model, streams, "cpu", kind)
    adapter.prepare(transformer, cfg.model)
    if t.base_dtype in quantise.DTYPES:
        quantise.quantise_base(transformer, t.base_dtype)
    checkpointing.set_mode(transformer, t.checkpointing)
    offload.offload_blocks(transformer, t.offload_blocks)
    out: FracTransformer = transformer.train()
    return out


def settle(transformer: Any, cfg: TrainConfig, tokens: int) -> None:
    """What is chosen once a transformer is on its device, for clips of so many tokens; raises ValueError for what does
    not work there."""
    parallel.enable_context_parallel(transformer, cfg.trainer.context_parallel, tokens)
    attention.set_backend(transformer, cfg.trainer.attention)
    if cfg.trainer.compile:
        compiling.compile_blocks(transformer)
