"""Block offload: frozen weights of some blocks wait in the memory of the host, for GPUs of 24 GB.

A block's weights are copied to the device before its forward pass and dropped behind it; gradient checkpointing runs
that forward pass again in the backward pass, and its graph holds them until the block's gradients are done. On CUDA the
next block's weights travel while the present one computes. Results are exact: the same numbers, elsewhere.

diffusers' own group offloading (0.42) is for inference: it moves trained weights too, with streams it brings back those
of its start, so that an adapter never learns, and it takes the data of tensors that a graph holds. The side stream has
not been run by the developers, who had no CUDA; the order of fetching has, on the CPU.
"""

from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from fracgen.memory.compiling import is_compiled


def offload_blocks(transformer: Any, count: int) -> "Offload | None":
    """Let the frozen weights of `count` blocks wait in the memory of the host; None for 0.

    Raises ValueError for more blocks than there are, without gradient checkpointing, or for compiled blocks.
    """
    blocks = list(transformer.blocks)
    if not count:
        return None
    if count > len(blocks):
        raise ValueError(f"trainer.offload_blocks={count} is more than the {len(blocks)} blocks of the transformer: "
                         f"set it to 0 to {len(blocks)}.")  # fmt: skip
    if not transformer.gradient_checkpointing:
        raise ValueError(f"trainer.offload_blocks={count} needs gradient checkpointing, which brings weights back for "
                         "the backward pass: set trainer.checkpointing=full or selective.")  # fmt: skip
    if is_compiled(transformer):
        raise ValueError(f"trainer.offload_blocks={count} does not go with compiled blocks: set trainer.compile=false.")
    return Offload([blocks[i * len(blocks) // count] for i in range(count)])


class Weight(NamedTuple):
    """A frozen weight that waits: where it belongs, what stands there meanwhile, and its value on the host."""

    module: nn.Module
    name: str
    empty: nn.Parameter
    host: Tensor


class Offload:
    """Blocks, spread evenly so that there is time to fetch the next one, and the weights that wait."""

    def __init__(self, blocks: list[nn.Module]) -> None:
        self.waiting = [_take(block) for block in blocks]
        self.fetched: dict[int, list[Tensor]] = {}
        self.stream: Any = None
        self.ahead = torch.cuda.is_available()
        self._hooks = []
        for index, block in enumerate(blocks):
            self._hooks.append(block.register_forward_pre_hook(lambda _, inputs, i=index: self._enter(i, inputs[0])))
            # Recomputation ends with an exception as soon as all is there that was to be kept.
            self._hooks.append(block.register_forward_hook(lambda *_, i=index: self._leave(i), always_call=True))

    def bytes_waiting(self) -> int:
        """Bytes of the weights that wait in the memory of the host."""
        return sum(weight.host.nbytes for block in self.waiting for weight in block)

    def remove(self) -> None:
        """Give the weights back, in the memory of the host, and forget."""
        for hook in self._hooks:
            hook.remove()
        for block in self.waiting:
            for weight in block:
                weight.empty.data = weight.host

    def _enter(self, index: int, tokens: Tensor) -> None:
        """Bring the weights of a block to the device of its input, and send for those of the next one."""
        if index not in self.fetched:
            self._fetch(index, tokens.device)
        here: Any = torch.cuda.current_stream(tokens.device) if self.stream is not None else None
        if here is not None:
            here.wait_stream(self.stream)
        for weight, tensor in zip(self.waiting[index], self.fetched.pop(index), strict=True):
            # Another tensor, not other data of the same one: the graph of a backward pass may hold the last.
            weight.module._parameters[weight.name] = nn.Parameter(tensor, requires_grad=False)
            if here is not None:
                tensor.record_stream(here)
        backward = torch._C._current_graph_task_id() != -1
        following = index - 1 if backward else index + 1
        if self.ahead and 0 <= following < len(self.waiting) and following not in self.fetched:
            self._fetch(following, tokens.device)

    def _leave(self, index: int) -> None:
        """Drop the weights of a block from the device; a graph that needs them holds them."""
        for weight in self.waiting[index]:
            weight.module._parameters[weight.name] = weight.empty

    def _fetch(self, index: int, device: torch.device) -> None:
        """Copy the weights of a block to the device, on CUDA beside its computation."""
        cuda: Any = torch.cuda
        if device.type == "cuda" and self.stream is None:
            self.stream = cuda.Stream(device)
        with cuda.stream(self.stream):  # None is no change
            self.fetched[index] = [w.host.to(device, non_blocking=True, copy=True) for w in self.waiting[index]]


def _take(block: nn.Module) -> list[Weight]:
    """The frozen weights of a block: emptied where they stand, their values on the host, pinned for CUDA."""
    out = []
    for module in block.modules():
        for name, parameter in module.named_parameters(recurse=False):
            if not parameter.requires_grad:
                host = parameter.data.cpu()
                host = host.pin_memory() if torch.cuda.is_available() else host
                out.append(Weight(module, name, parameter, host))
                parameter.data = torch.empty(0, dtype=host.dtype, device=parameter.device)
    return out
