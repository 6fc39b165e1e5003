"""Frozen weights in 8 bits: half the memory of bfloat16 for the base under an adapter; nothing trained is touched.

Each row of a weight (an output channel) has its own scale in float32; the product runs in the type of the input.
"""

import torch
from torch import Tensor, nn
from torch.nn.functional import linear as product

INT8, FLOAT8 = "int8", "float8"
LARGEST = {INT8: 127.0, FLOAT8: 448.0}
"""Largest numbers of int8 (symmetric) and of float8 e4m3 (Micikevicius et al. 2022)."""
DTYPES = {INT8: torch.int8, FLOAT8: torch.float8_e4m3fn}
STORED = {INT8: torch.int8, FLOAT8: torch.uint8}
"""What codes are stored as: no cast of a module and no back-end of torch.distributed stumbles over whole numbers."""


class QuantisedLinear(nn.Linear):
    """A frozen linear layer whose weight is stored in 8 bits; peft puts adapters on it as on any linear layer.

    The weight is restored for each product. Where it is needed again in the backward pass, autograd keeps the restored
    one, so that gradient checkpointing belongs to it.
    """

    def __init__(self, linear: nn.Linear, kind: str) -> None:
        nn.Module.__init__(self)
        self.in_features, self.out_features = linear.in_features, linear.out_features
        codes, scale = quantise(linear.weight.detach(), kind)
        self.weight = nn.Parameter(codes, requires_grad=False)
        self.scale = nn.Parameter(scale, requires_grad=False)
        self.bias = linear.bias

    def forward(self, x: Tensor) -> Tensor:
        """`x` [..., in] times the restored weight, and the bias, [..., out]."""
        bias = None if self.bias is None else self.bias.to(x.dtype)
        return product(x, restore(self.weight, self.scale).to(x.dtype), bias)


def quantise(weight: Tensor, kind: str) -> tuple[Tensor, Tensor]:
    """Codes [out, in] and scales [out, 1] float32 of a `weight` [out, in]; `kind` is "int8" or "float8".

    The error of int8 is at most half a step, scale / 2. That of float8, which has 3 bits of mantissa and the least
    exponent -6, is at most the greater of |w| / 16 and scale / 1024.
    """
    w = weight.float()
    largest = w.abs().amax(dim=1, keepdim=True)
    # A row of zeros gets any scale; a very small one could be flushed to zero.
    scale = torch.where(largest > 0, largest, 1.0) / LARGEST[kind]
    codes = w / scale
    return (codes.round() if kind == INT8 else codes).to(DTYPES[kind]).view(STORED[kind]), scale


def restore(codes: Tensor, scale: Tensor) -> Tensor:
    """The weight [out, in] float32 of codes and scales."""
    numbers = codes if codes.dtype == torch.int8 else codes.view(torch.float8_e4m3fn)
    return numbers.float() * scale


def quantise_base(transformer: nn.Module, kind: str) -> int:
    """Store the frozen linear layers of the blocks in 8 bits and return how many they are; in place.

    Call it after `fracgen.model.adapter.prepare`, which says what is frozen. Raises ValueError if nothing is.
    """
    if kind not in DTYPES:
        raise ValueError(f"trainer.base_dtype={kind} is not a type of 8 bits: it must be one of {', '.join(DTYPES)}.")
    blocks = transformer.get_submodule("blocks")
    found = [(parent, name, child) for parent in blocks.modules() for name, child in parent.named_children()
             if type(child) is nn.Linear and not child.weight.requires_grad]  # fmt: skip
    if not found:
        raise ValueError(f"trainer.base_dtype={kind} needs frozen weights, but all are trained: set model.train=lora "
                         "or trainer.base_dtype=bfloat16.")  # fmt: skip
    for parent, name, child in found:
        setattr(parent, name, QuantisedLinear(child, kind))
    return len(found)
