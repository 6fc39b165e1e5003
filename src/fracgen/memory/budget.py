"""Memory of a training on a device: weights, gradients, states of the optimiser, activations."""

from collections.abc import Sequence
from dataclasses import dataclass

from fracgen.config.train import TrainConfig
from fracgen.memory.blank import Weights, weights
from fracgen.memory.devices import Device
from fracgen.memory.size import Size
from fracgen.memory.trace import activations

STATE_BYTES = {"adamw": 8.0, "adamw8bit": 2 + 8 / 256}
"""Bytes of the optimiser's states for each trained number: two of 4 bytes, or two of 1 and a scale for 256 of them."""
IN_TRANSIT = 2
"""Blocks whose offloaded weights are on the device at a time: the one that computes and the next one."""


@dataclass(frozen=True)
class Memory:
    """Bytes on one device at the worst moment of a step, and what the device has."""

    frozen: int
    """Weights that are not trained."""
    trained: int
    """Weights that are trained, and their average if there is one."""
    gradients: int
    states: int
    """Of the optimiser."""
    kept: int
    """Activations between the forward and the backward pass."""
    inside: int
    """What comes on top within a block."""
    reserve: int
    """What tensors do not get."""
    capacity: int
    """What the device has."""

    @property
    def total(self) -> int:
        """All of it but the capacity."""
        return self.frozen + self.trained + self.gradients + self.states + self.kept + self.inside + self.reserve

    @property
    def fits(self) -> bool:
        """Whether the device has as much."""
        return self.total <= self.capacity


_known: dict[tuple[object, ...], Weights] = {}
"""Weights by setting."""


def counted(cfg: TrainConfig, streams: Sequence[str]) -> Weights:
    """The weights of the transformer of `cfg`; built once for each setting."""
    key = repr(cfg.model), tuple(streams), cfg.trainer.base_dtype
    if key not in _known:
        _known[key] = weights(cfg, streams)
    return _known[key]


def memory(cfg: TrainConfig, streams: Sequence[str], size: Size, device: Device) -> Memory:
    """Memory of a step on a batch of `size`; raises ValueError for settings that no training can have.

    The worst moment is the backward pass when gradients of an earlier batch of the optimiser step are there.
    """
    trainer = cfg.trainer
    own, acts = counted(cfg, streams), activations(cfg, streams, size)
    waiting = max(0, min(trainer.offload_blocks, cfg.model.layers) - IN_TRANSIT)
    average = own.trained_bytes if trainer.ema else 0
    return Memory(
        frozen=own.frozen_bytes - waiting * own.block_bytes,
        trained=own.trained_bytes + average,
        gradients=own.trained_bytes,
        states=int(own.trained * STATE_BYTES[trainer.optimizer]),
        kept=acts.kept // trainer.context_parallel,
        inside=acts.inside // trainer.context_parallel,
        reserve=device.reserve,
        capacity=device.memory,
    )
