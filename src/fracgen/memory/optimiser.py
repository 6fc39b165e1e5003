"""AdamW (Loshchilov and Hutter 2019), with states of 32 or of 8 bits (Dettmers et al. 2022)."""

from collections.abc import Iterable, Mapping
from typing import Any

import torch
from torch.optim import AdamW, Optimizer

from fracgen.config.train import Trainer

FUSED = ("cpu", "cuda", "mps", "xpu")
"""Devices with an AdamW that is one kernel."""


def build(groups: Iterable[Mapping[str, Any]], cfg: Trainer) -> Optimizer:
    """The optimiser of parameter groups, each with `params`, `lr`, and perhaps `weight_decay` instead of that of `cfg`.

    Raises ValueError when nothing is trained, or adamw8bit lacks its package.
    """
    content = [{**group, "params": list(group["params"])} for group in groups]
    devices = {p.device.type for group in content for p in group["params"]}
    if not devices:
        raise ValueError("nothing is trained: set model.train=lora or full.")
    if cfg.optimizer == "adamw8bit":
        return _eight_bit(content, cfg.weight_decay)
    fused = devices <= set(FUSED) and all(torch.is_floating_point(p) for group in content for p in group["params"])
    out: Any = AdamW(content, weight_decay=cfg.weight_decay, fused=fused)
    # The fused kernel could also undo the loss scaling of float16, which we do not offer. Lightning takes that for a
    # reason to refuse the clipping of gradients.
    out._step_supports_amp_scaling = False
    result: Optimizer = out
    return result


def _eight_bit(groups: list[dict[str, Any]], weight_decay: float) -> Optimizer:
    """AdamW with states of 8 bits; parameters of less than 4096 numbers keep 32."""
    try:
        from bitsandbytes.optim import AdamW8bit
    except ImportError:
        raise ValueError("trainer.optimizer=adamw8bit needs the package bitsandbytes: pip install 'fracsim[lowmem]', "
                         "or set trainer.optimizer=adamw.") from None  # fmt: skip
    out: Optimizer = AdamW8bit(groups, weight_decay=weight_decay)
    return out
