"""torch.compile of the transformer's blocks: one block is compiled, and all run it."""

from functools import cache
from typing import Any

import torch

from fracgen.model import FracTransformer


def compile_blocks(transformer: FracTransformer, device: str | None = None, backend: str = "inductor") -> None:
    """Compile the blocks; the first step takes longer for it.

    `device` is what will run the transformer, if it is not there yet; `backend` is that of torch.compile. Raises
    ValueError if torch.compile does not work there, which is tried out, or if weights of blocks wait elsewhere.
    """
    if not all(parameter.numel() for parameter in transformer.blocks.parameters()):
        raise ValueError("trainer.compile=true does not go with offloaded blocks: set trainer.offload_blocks=0.")
    reason = _fault(torch.device(device or next(transformer.parameters()).device).type, backend)
    if reason:
        raise ValueError(f"trainer.compile=true: torch.compile does not work on this machine ({reason}): install a C++ "
                         "compiler (CPU) or triton (CUDA), or set trainer.compile=false.")  # fmt: skip
    network: Any = transformer
    network.compile_repeated_blocks(fullgraph=True, backend=backend)


def is_compiled(transformer: torch.nn.Module) -> bool:
    """Whether the blocks are compiled."""
    return any(module._compiled_call_impl is not None for module in transformer.modules())


@cache
def _fault(device: str, backend: str) -> str | None:
    """Why torch.compile does not work for a device, found by compiling a sum; None if it does."""
    try:
        torch.compile(_plus_one, backend=backend)(torch.zeros(4, device=device))
    except Exception as error:  # of the compiler, of its search, of torch
        return str(error).strip().split("\n")[0][:150] or type(error).__name__
    return None


def _plus_one(x: torch.Tensor) -> torch.Tensor:
    return x + 1
