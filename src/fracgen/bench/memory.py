"""Peak memory of a training step against what `fracgen.memory` plans.

On a CPU the peak is that of all tensors, counted storage by storage; on CUDA it is that of PyTorch's allocator.
"""

from collections.abc import Iterator

import torch

from fracgen.bench import cases
from fracgen.bench.record import Row
from fracgen.config.train import TrainConfig
from fracgen.memory.budget import memory
from fracgen.memory.devices import of_bytes
from fracgen.memory.live import LiveBytes
from fracgen.memory.size import Size
from fracgen.training.module import Module

MB = 1e6
NEAR = 5.0
"""Largest difference between plan and measurement [%]: what the losses keep is not planned."""


def rows(quick: bool = False) -> Iterator[Row]:
    """Measured and planned peak, and the difference, of each size, precision and mode of checkpointing."""
    cuda = torch.cuda.is_available()
    for name in ("tiny",) if quick else cases.MODELS:
        model = cases.MODELS[name]
        size = Size(32, 32, 5, 2) if quick else cases.SIZES[name]
        for precision in ("32-true",) if quick else ("32-true", "bf16-mixed"):
            for mode in cases.MODES:
                cfg = cases.config(model, mode, precision)
                found = on_cuda(cfg, size) if cuda else measured(cfg, size)
                planned = plan(cfg, size)
                label = f"{name} ({model.train}), {size.tokens} tokens, {precision}, checkpointing={mode}"
                yield Row("peak memory, measured", label, found / MB, "MB")
                yield Row("peak memory, planned", label, planned / MB, "MB")
                difference = 100 * abs(planned / found - 1)
                yield Row("difference", label, difference, "%", None if quick else NEAR)


def plan(cfg: TrainConfig, size: Size) -> int:
    """Planned bytes of tensors at the worst moment of a step."""
    found = memory(cfg, cases.streams_of(size), size, of_bytes(1))
    return found.total - found.reserve


def measured(cfg: TrainConfig, size: Size) -> int:
    """The most bytes of tensors that were alive in an optimiser step of two batches, on the CPU."""
    with LiveBytes() as live:
        module, optimiser = _started(cfg, size, "cpu")
        live.peak = live.now
        _step(module, optimiser, size)
    return int(live.peak)


def on_cuda(cfg: TrainConfig, size: Size) -> int:
    """The same on a GPU."""
    module, optimiser = _started(cfg, size, "cuda")
    torch.cuda.reset_peak_memory_stats()
    _step(module, optimiser, size)
    return int(torch.cuda.max_memory_allocated())


def _started(cfg: TrainConfig, size: Size, device: str) -> tuple[Module, torch.optim.Optimizer]:
    """A module and an optimiser that has its states."""
    module = cases.module(cfg, size, device)
    optimiser = module.configure_optimizers()
    _step(module, optimiser, size)
    return module, optimiser


def _step(module: Module, optimiser: torch.optim.Optimizer, size: Size) -> None:
    """An optimiser step of two batches; the second one meets the gradients of the first."""
    device = next(module.parameters()).device.type
    optimiser.zero_grad(set_to_none=True)
    for _ in range(2):
        cases.forward_backward(module, cases.batch(module.cfg.model, size, device))
    optimiser.step()
