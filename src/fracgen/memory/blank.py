"""The transformer as it is trained, without numbers and without memory: for counts, shapes and traces."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import torch
from torch import nn

from fracgen import model
from fracgen.config.train import TrainConfig
from fracgen.memory import checkpointing, quantise
from fracgen.model import FracTransformer, adapter
from fracgen.model.load import keeps_float32


@dataclass(frozen=True)
class Weights:
    """Parameters of the transformer, and the bytes that they take on a device."""

    total: int
    """Parameters, adapters among them."""
    trained: int
    """Those that are trained."""
    frozen_bytes: int
    """Bytes of those that are not, in their type, and of buffers."""
    block_bytes: int
    """Bytes of those of a block."""
    trained_bytes: int
    """Bytes of those that are trained: float32."""


def blank(cfg: TrainConfig, streams: Sequence[str], layers: int) -> FracTransformer:
    """The transformer on the meta device: frozen, adapted, quantised, checkpointed; `layers` blocks of it.

    Raises ValueError as these steps do.
    """
    network: Any = adapted(cfg, streams, layers)
    if cfg.trainer.base_dtype in quantise.DTYPES:
        quantise.quantise_base(network, cfg.trainer.base_dtype)
    checkpointing.set_mode(network, cfg.trainer.checkpointing)
    return cast(FracTransformer, network)


def adapted(cfg: TrainConfig, streams: Sequence[str], layers: int) -> FracTransformer:
    """The transformer on the meta device, with its adapters, before its base becomes one of 8 bits."""
    small = replace(cfg.model, layers=layers)
    network: Any = model.empty(small, streams)
    dtype = torch.float32 if cfg.trainer.base_dtype == "float32" else torch.bfloat16
    for name, parameter in network.named_parameters():
        if not keeps_float32(network, name):
            parameter.data = parameter.data.to(dtype)
    adapter.prepare(network, small)
    return cast(FracTransformer, network)


def weights(cfg: TrainConfig, streams: Sequence[str]) -> Weights:
    """Parameters of the transformer of `cfg`: of one block times its blocks, and of the rest.

    Counts are those before a base becomes one of 8 bits, which adds scales.
    """
    network, layers = adapted(cfg, streams, 1), cfg.model.layers
    block = network.blocks[0]

    def count(module: nn.Module, trained: Sequence[bool]) -> int:
        return sum(p.numel() for p in module.parameters() if p.requires_grad in trained)

    total, trained = (count(network, kind) + (layers - 1) * count(block, kind) for kind in ((True, False), (True,)))
    if cfg.trainer.base_dtype in quantise.DTYPES:
        quantise.quantise_base(network, cfg.trainer.base_dtype)
    buffers = sum(b.nbytes for b in network.buffers())
    frozen = _bytes(block, trained=False)
    return Weights(
        total=total,
        trained=trained,
        frozen_bytes=_bytes(network, trained=False) + (layers - 1) * frozen + buffers,
        block_bytes=frozen,
        trained_bytes=_bytes(network, trained=True) + (layers - 1) * _bytes(block, trained=True),
    )


def _bytes(module: nn.Module, trained: bool) -> int:
    return sum(p.nbytes for p in module.parameters() if p.requires_grad is trained)


def materialise(network: nn.Module) -> None:
    """Give a network on the meta device weights and buffers on the CPU, within a FakeTensorMode fake ones.

    The kernels of attention are then those of a CPU, which keep what those of a GPU keep; "meta" has none of these.
    """
    for module in network.modules():
        for name, parameter in list(module.named_parameters(recurse=False)):
            like = torch.zeros(parameter.shape, dtype=parameter.dtype)
            setattr(module, name, nn.Parameter(like, requires_grad=parameter.requires_grad))
        for name, buffer in list(module.named_buffers(recurse=False)):
            setattr(module, name, torch.zeros(buffer.shape, dtype=buffer.dtype))
