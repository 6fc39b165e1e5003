"""Gradient checkpointing: activations of a block are recomputed in the backward pass instead of kept (Chen et al. 2016).

Every mode gives the same gradients. `selective` keeps the outputs of attention, which are most of the cost of a long
clip and little of its memory.
"""

from functools import partial
from typing import Any

import torch
from diffusers import WanTransformer3DModel
from torch import nn
from torch.utils.checkpoint import (
    CheckpointPolicy,
    checkpoint,
    create_selective_checkpoint_contexts,
)

MODES = ("none", "full", "selective")
ATTENTION = (
    "aten::_scaled_dot_product_flash_attention_for_cpu", "aten::_scaled_dot_product_flash_attention",
    "aten::_scaled_dot_product_efficient_attention", "aten::_scaled_dot_product_cudnn_attention",
    "aten::_scaled_dot_product_fused_attention_overrideable", "aten::_scaled_dot_product_attention_math",
    "flash_attn::_flash_attn_forward", "flash_attn_3::fwd", "xformers::efficient_attention_forward_cutlass",
)  # fmt: skip
"""Operators that attention ends in, one or more for each back-end."""


def set_mode(transformer: WanTransformer3DModel, mode: str) -> None:
    """Recompute nothing ("none"), whole blocks ("full"), or all but attention ("selective"); raises ValueError."""
    if mode not in MODES:
        raise ValueError(f"trainer.checkpointing={mode} is not allowed: it must be one of {', '.join(MODES)}.")
    if mode == "none":
        transformer.disable_gradient_checkpointing()
        return
    settings: dict[str, Any] = {"use_reentrant": False}  # the reentrant form loses gradients of a frozen base's adapters
    if mode == "selective":
        settings["context_fn"] = partial(create_selective_checkpoint_contexts, _policy)

    def run(block: nn.Module, *inputs: Any) -> Any:
        return checkpoint(block, *inputs, **settings)

    transformer.enable_gradient_checkpointing(run)


def _policy(context: Any, operator: Any, *args: Any, **kwargs: Any) -> CheckpointPolicy:
    """What becomes of the output of an operator."""
    name = operator.name() if isinstance(operator, torch._ops.OpOverload) else ""
    kept = name.partition(".")[0] in ATTENTION
    return CheckpointPolicy.MUST_SAVE if kept else CheckpointPolicy.PREFER_RECOMPUTE
