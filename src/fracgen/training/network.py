"""The transformer of a stage, with its base weights, its adapters, and as it is to run on this machine."""

import torch

from fracgen import model
from fracgen.config.train import TrainConfig
from fracgen.memory import attention, checkpointing, compiling, offload, quantise
from fracgen.model import FracTransformer, adapter


def build(cfg: TrainConfig, streams: tuple[str, ...]) -> FracTransformer:
    """The transformer on the CPU, with what is trained in float32; raises ValueError for what cannot be used."""
    kind = torch.float32 if cfg.trainer.base_dtype == "float32" else torch.bfloat16
    transformer = model.build(cfg.model, streams, "cpu", kind)
    adapter.prepare(transformer, cfg.model)
    if cfg.trainer.base_dtype in quantise.DTYPES:
        quantise.quantise_base(transformer, cfg.trainer.base_dtype)
    checkpointing.set_mode(transformer, cfg.trainer.checkpointing)
    offload.offload_blocks(transformer, cfg.trainer.offload_blocks)  # before the device gets to hold them
    return transformer.train()


def settle(transformer: FracTransformer, cfg: TrainConfig) -> None:
    """What can be chosen only once the transformer is on its device; raises ValueError for what does not work there."""
    attention.set_backend(transformer, cfg.trainer.attention)
    if cfg.trainer.compile:
        compiling.compile_blocks(transformer)
