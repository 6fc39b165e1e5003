"""Memory of activations, found by running the real modules on fake tensors: shapes and types, no numbers, no memory."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensorMode

from fracgen import model
from fracgen.conditioning import CONDITION_CHANNELS
from fracgen.config.model import Model
from fracgen.config.train import TrainConfig
from fracgen.denoiser import Inputs, velocity
from fracgen.layout import CHANNELS
from fracgen.memory import checkpointing
from fracgen.memory.live import LiveBytes
from fracgen.memory.size import IMAGE_TOKENS, TEXT_TOKENS, Size
from fracgen.model import adapter


@dataclass(frozen=True)
class Activations:
    """Bytes of activations of a forward and backward pass."""

    kept: int
    """Alive between the two passes."""
    peak: int
    """The most that is ever alive, gradients of weights apart."""

    @property
    def inside(self) -> int:
        """What comes on top for a while: tensors within one block, and what checkpointing computes again."""
        return self.peak - self.kept

    def beyond(self, more: "Activations", layers: int) -> "Activations":
        """The activations at `layers` more layers, each of which adds what `more`, one layer more, adds."""
        return Activations(self.kept + layers * (more.kept - self.kept), self.peak + layers * (more.peak - self.peak))


FEW = 2
"""Layers that are traced; every further layer adds the same."""

_known: dict[tuple[object, ...], Activations] = {}
"""Activations by setting."""


def activations(cfg: TrainConfig, streams: Sequence[str], size: Size) -> Activations:
    """Activations of the transformer of `cfg` on a batch of `size`; takes about a second, once for each setting."""
    t = cfg.trainer
    key = repr(cfg.model), tuple(streams), size, t.checkpointing, t.precision, t.base_dtype, t.attention
    if key not in _known:
        layers = cfg.model.layers
        few = trace(cfg, streams, size, min(layers, FEW))
        more = trace(cfg, streams, size, FEW + 1) if layers > FEW else few
        _known[key] = few.beyond(more, max(0, layers - FEW))
    return _known[key]


def trace(cfg: TrainConfig, streams: Sequence[str], size: Size, layers: int) -> Activations:
    """Run `layers` blocks of the transformer forward and backward on fake tensors and count what is alive."""
    network = prepared(cfg, streams, layers)
    with _quiet(), FakeTensorMode():
        materialise(network)
        network.train()
        for parameter in network.parameters():
            if parameter.requires_grad:
                parameter.grad = torch.zeros_like(parameter)  # as after the first batch of an optimiser step
        with LiveBytes(owned(network)) as live:
            loss = _loss(cfg, network, size)
            kept = live.now
            loss.backward()  # type: ignore[no-untyped-call]
        return Activations(kept, live.peak)


def prepared(cfg: TrainConfig, streams: Sequence[str], layers: int, device: str = "meta") -> torch.nn.Module:
    """The transformer as it is trained, at random weights: frozen, adapted, checkpointed."""
    small = replace(cfg.model, path="", hub=False, layers=layers)
    dtype = torch.float32 if cfg.trainer.base_dtype == "float32" else torch.bfloat16
    network = model.build(small, streams, device, dtype)
    adapter.prepare(network, small)
    checkpointing.apply(network, cfg.trainer.checkpointing)
    return network


def materialise(network: torch.nn.Module) -> None:
    """Give a network on the meta device weights and buffers on the CPU, within a FakeTensorMode fake ones.

    The kernels of attention are then those of a CPU, which keep what those of a GPU keep; "meta" has none of these.
    """
    for module in network.modules():
        for name, parameter in list(module.named_parameters(recurse=False)):
            like = torch.zeros(parameter.shape, dtype=parameter.dtype)
            setattr(module, name, torch.nn.Parameter(like, requires_grad=parameter.requires_grad))
        for name, buffer in list(module.named_buffers(recurse=False)):
            setattr(module, name, torch.zeros(buffer.shape, dtype=buffer.dtype))


def owned(network: torch.nn.Module) -> list[Tensor]:
    """Weights, their gradients and buffers."""
    grads = [p.grad for p in network.parameters() if p.grad is not None]
    return [*network.parameters(), *network.buffers(), *grads]


def inputs(cfg: Model, size: Size) -> tuple[Tensor, Tensor, Inputs]:
    """A noisy latent, noise levels and conditions for a batch of `size`: random numbers of the right shapes."""
    frames, rows, columns = size.latent
    batch = size.batch
    image = torch.randn(batch, IMAGE_TOKENS, cfg.image_dim) if cfg.image_dim else None
    return (
        torch.randn(batch, CHANNELS, frames, rows, columns),
        torch.rand(batch),
        Inputs(
            channels=torch.randn(batch, CONDITION_CHANNELS, frames, rows, columns),
            reference=torch.randn(batch, CHANNELS, rows, columns),
            text=torch.randn(batch, TEXT_TOKENS, cfg.text_dim),
            image=image,
        ),
    )


def _loss(cfg: TrainConfig, network: Any, size: Size) -> Tensor:
    """The loss of a batch, as far as memory goes: a mean square of the predicted velocity."""
    x, sigma, conditions = inputs(cfg.model, size)
    with torch.autocast("cpu", torch.bfloat16, enabled=cfg.trainer.precision == "bf16-mixed"):
        predicted = velocity(network, x, sigma, conditions)
    return (predicted.float() - torch.randn_like(x)).square().mean()


@contextmanager
def _quiet() -> Iterator[None]:
    """Without warnings: nothing is computed that they could be about."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
