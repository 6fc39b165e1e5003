"""Gradient checkpointing (Chen et al. 2016): activations of a block are recomputed in the backward pass, not kept.

Every mode gives the same gradients. `selective` keeps the outputs of self-attention, which are most of the cost of a
long clip and little of its memory. Those of cross-attention take as much memory and save next to nothing: caption and
picture have 769 tokens, a clip of five streams of 512 x 512 pixels has 112,640.
"""

from functools import partial
from typing import Any

import torch
from torch import nn
from torch.utils.checkpoint import (
    CheckpointPolicy,
    checkpoint,
    create_selective_checkpoint_contexts,
)

from fracgen.model import FracTransformer

MODES = ("none", "full", "selective")
ATTENTION = (
    "aten::_scaled_dot_product_flash_attention_for_cpu", "aten::_scaled_dot_product_flash_attention",
    "aten::_scaled_dot_product_efficient_attention", "aten::_scaled_dot_product_cudnn_attention",
    "aten::_scaled_dot_product_fused_attention_overrideable",
    "flash_attn::_flash_attn_forward", "_diffusers_flash_attn_3::_flash_attn_forward",
)  # fmt: skip
"""Operators that attention ends in: those of PyTorch, and those of the flash-attn packages, which have not been run
here. A back-end that ends in another one, as _native_math, which is many, is recomputed like all the rest."""


def set_mode(transformer: FracTransformer, mode: str) -> None:
    """Recompute nothing ("none"), whole blocks ("full"), or all but self-attention ("selective"); raises
    ValueError."""
    if mode not in MODES:
        raise ValueError(f"trainer.checkpointing={mode} is not allowed: it must be one of {', '.join(MODES)}.")
    if mode == "none":
        transformer.disable_gradient_checkpointing()
        return
    settings: dict[str, Any] = {"use_reentrant": False}  # else a frozen base's adapters get no gradient
    if mode == "selective":
        settings["context_fn"] = partial(create_selective_checkpoint_contexts, _policy)

    def run(block: nn.Module, *inputs: Any) -> Any:
        return checkpoint(block, *inputs, **settings)

    transformer.enable_gradient_checkpointing(run)


def _policy(context: Any, operator: Any, *args: Any, **kwargs: Any) -> CheckpointPolicy:
    """What becomes of the output of an operator."""
    kept = isinstance(operator, torch._ops.OpOverload) and str(operator._schema.name) in ATTENTION
    kept = kept and args[0].shape == args[1].shape  # query and key: of the same tokens, so this is self-attention
    return CheckpointPolicy.MUST_SAVE if kept else CheckpointPolicy.PREFER_RECOMPUTE
