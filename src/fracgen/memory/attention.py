"""Back-ends of attention, as diffusers names them."""

import logging
from functools import cache
from typing import Any

import torch
from diffusers.models import attention_dispatch as dispatch

from fracgen.model import FracTransformer

REMOTE = "_hub"
"""Ending of back-ends whose kernels diffusers downloads."""


def set_backend(transformer: FracTransformer, name: str, device: str | None = None, *, training: bool = True) -> None:
    """Let attention run by the back-end `name`, which is tried out first.

    `device` is what will run the transformer, if it is not there yet. Raises ValueError, listing what this machine has,
    for a back-end that is unknown, not installed, without support for the device or, in `training`, without gradients.
    """
    kind = torch.device(device or next(transformer.parameters()).device).type
    reason = _fault(name, kind, training)
    if reason:
        raise ValueError(f"trainer.attention={name} cannot be used on this machine ({reason}): it has "
                         f"{', '.join(available(kind, training=training))}.")  # fmt: skip
    log = logging.getLogger("diffusers.models.modeling_utils")
    level = log.level
    try:
        log.setLevel(logging.ERROR)  # it calls all back-ends experimental
        transformer.set_attention_backend(name)
    finally:
        log.setLevel(level)


def available(device: str = "cpu", *, training: bool = True) -> list[str]:
    """Names of the back-ends that work on a device ("cpu", "cuda"), without those that would be downloaded."""
    names = [name.value for name in dispatch.AttentionBackendName]
    return [n for n in names if not n.endswith(REMOTE) and _fault(n, device, training) is None]


@cache
def _fault(name: str, device: str, training: bool) -> str | None:
    """Why a back-end does not work here, found by running it on a few tokens; None if it does."""
    try:
        backend = dispatch.AttentionBackendName(name)
    except ValueError:
        return "there is no such back-end"
    query: Any = torch.ones(1, 16, 2, 64, device=device, dtype=torch.bfloat16, requires_grad=training)
    try:
        dispatch._check_attention_backend_requirements(backend)
        dispatch._maybe_download_kernel_for_backend(backend)
        out: Any = dispatch.dispatch_attention_fn(query, query, query, backend=backend)
        if training:
            torch.autograd.grad(out.float().sum(), query)
    except Exception as error:  # what libraries of kernels raise is not ours to list
        return str(error).strip().split("\n")[0][:150] or type(error).__name__
    return None
