"""Memory of activations, found by running the real modules on fake tensors: shapes and types, no numbers, no memory."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensorMode

from fracgen.conditioning import CONDITION_CHANNELS
from fracgen.config.model import Model
from fracgen.config.train import TrainConfig
from fracgen.denoiser import Inputs, velocity
from fracgen.layout import CHANNELS
from fracgen.memory.blank import blank, materialise
from fracgen.memory.live import LiveBytes
from fracgen.memory.size import IMAGE_TOKENS, TEXT_TOKENS, Size
from fracgen.model import FracTransformer


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

    def beyond(self, more: int) -> "Activations":
        """The activations when `more` bytes more are kept."""
        return Activations(self.kept + more, self.peak + more)


FEW = 2
"""Blocks that are traced. Every further block keeps what the second one keeps: the first one's input may need no
gradient."""

_known: dict[tuple[object, ...], Activations] = {}
"""Activations by setting."""


def activations(cfg: TrainConfig, streams: Sequence[str], size: Size) -> Activations:
    """Activations of the transformer of `cfg` on a batch of `size`; takes a second, once for each setting."""
    t = cfg.trainer
    key = repr(cfg.model), tuple(streams), size, t.checkpointing, t.precision, t.base_dtype, t.attention
    if key not in _known:
        few, block = trace(cfg, streams, size, min(cfg.model.layers, FEW))
        _known[key] = few.beyond(max(0, cfg.model.layers - FEW) * block)
    return _known[key]


def trace(cfg: TrainConfig, streams: Sequence[str], size: Size, layers: int) -> tuple[Activations, int]:
    """Run `layers` blocks forward and backward on fake tensors, count what is alive, and what the last one keeps."""
    network = blank(cfg, streams, layers)
    behind: list[int] = []
    with _quiet(), FakeTensorMode():
        materialise(network)
        network.train()
        for parameter in network.parameters():
            if parameter.requires_grad:
                parameter.grad = torch.zeros_like(parameter)  # as after the first batch of an optimiser step
        with LiveBytes(owned(network)) as live:
            for block in network.blocks:
                block.register_forward_hook(lambda *_: behind.append(_settled(live)))
            loss = _loss(cfg, network, size)
            kept = live.now
            loss.backward()  # type: ignore[no-untyped-call]
        return Activations(kept, live.peak), behind[layers - 1] - behind[layers - 2] if layers > 1 else 0


def _settled(live: LiveBytes) -> int:
    """Bytes alive without the casts of weights that autocast holds until its end."""
    torch.clear_autocast_cache()
    return live.now


def owned(network: FracTransformer) -> list[Tensor]:
    """Weights, their gradients and buffers, of any shape."""
    grads = [p.grad for p in network.parameters() if p.grad is not None]
    return [*network.parameters(), *network.buffers(), *grads]


def inputs(cfg: Model, size: Size) -> tuple[Tensor, Tensor, Inputs]:
    """A noisy latent [B, 16, T, S H, W], noise levels [B] and conditions for a batch of `size`: random numbers."""
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


def _loss(cfg: TrainConfig, network: FracTransformer, size: Size) -> Tensor:
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
