"""Floating-point operations of a training step, in closed form: a matrix product m x k times k x n takes 2 m k n.

Counted are matrix products, convolutions and attention, as `torch.utils.flop_counter` counts them. Left out are
normalisations, rotary embeddings, activation functions, the loss and the optimiser, which read memory more than they
compute, and the constitutive maps f and g (272 numbers each).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from fracgen.conditioning import CONDITION_CHANNELS
from fracgen.config.model import Model
from fracgen.layout import CHANNELS, PATCH
from fracgen.memory.size import IMAGE_TOKENS, TEXT_TOKENS, Size

FREQUENCIES = 256
"""Channels of the sinusoidal embedding of the noise level."""
ATTENTION_BACKWARD = 2.5
"""Products of attention's backward pass, five since scores are computed again, over the two of its forward pass."""


class Product(NamedTuple):
    """Equal products, `times` of them, and how many of the same size the backward pass has for each."""

    part: str
    """linear, attention, or cross: attention whose query and keys have different lengths."""
    place: str
    """block (computed again by checkpointing) or edge."""
    forward: float
    """Operations of the forward pass."""
    backward: float
    """Products of the backward pass over those of the forward pass."""


@dataclass(frozen=True)
class Flops:
    """Operations of one forward and backward pass of a batch."""

    linear: float
    """Forward pass: linear layers and convolutions."""
    attention: float
    """Forward pass: attention."""
    recompute: float
    """Forward passes that checkpointing repeats."""
    backward: float
    """Backward pass."""

    @property
    def forward(self) -> float:
        """The forward pass."""
        return self.linear + self.attention

    @property
    def total(self) -> float:
        """All of a training step but the optimiser."""
        return self.forward + self.recompute + self.backward


def flops(cfg: Model, size: Size, checkpointing: str) -> Flops:
    """Operations of a step of the transformer `cfg` on a batch of `size`; `checkpointing` is none, full or selective.

    Selective checkpointing keeps the outputs of self-attention, so that linear layers and cross-attention are computed
    again.
    """
    products = list(_edges(cfg, size))
    for block in range(cfg.layers):
        products += _block(cfg, size, input_grad=block > 0 or edge_grad(cfg))
    again = {"none": (), "full": ("linear", "cross", "attention"), "selective": ("linear", "cross")}[checkpointing]
    return Flops(
        linear=sum(p.forward for p in products if p.part == "linear"),
        attention=sum(p.forward for p in products if p.part != "linear"),
        recompute=sum(p.forward for p in products if p.place == "block" and p.part in again),
        backward=sum(p.forward * p.backward for p in products),
    )


def edge_grad(cfg: Model) -> bool:
    """Whether what enters the first block needs a gradient, since a weight before it is trained."""
    return cfg.train == "full" or cfg.train_patch_embed != "none" or cfg.rope == "shared"


def _edges(cfg: Model, size: Size) -> Iterator[Product]:
    """What is before and after the blocks."""
    dim, full, batch = cfg.heads * cfg.head_dim, cfg.train == "full", size.batch

    def linear(rows: int, inner: int, columns: int, backward: int) -> Product:
        return Product("linear", "edge", 2.0 * batch * rows * inner * columns, backward)

    patch = PATCH * PATCH
    first, later = int(full), 2 * full  # inputs need no gradient, hidden layers do
    yield linear(size.video_tokens, (CHANNELS + CONDITION_CHANNELS) * patch, dim,
                 int(full or cfg.train_patch_embed != "none"))  # fmt: skip
    yield linear(size.reference_tokens, CHANNELS * patch, dim, first)
    yield linear(1, FREQUENCIES, dim, first)
    yield linear(1, dim, dim, later)
    yield linear(1, dim, 6 * dim, later)
    yield linear(TEXT_TOKENS, cfg.text_dim, dim, first)
    yield linear(TEXT_TOKENS, dim, dim, later)
    if cfg.image_dim:
        yield linear(IMAGE_TOKENS, cfg.image_dim, cfg.image_dim, later)
        yield linear(IMAGE_TOKENS, cfg.image_dim, dim, later)
    yield linear(size.tokens, dim, CHANNELS * patch, 1 + full)


def _block(cfg: Model, size: Size, input_grad: bool) -> Iterator[Product]:
    """One transformer block; `input_grad` says whether its input needs a gradient."""
    dim, tokens = cfg.heads * cfg.head_dim, size.tokens
    context_grad = cfg.train == "full"  # captions pass through frozen layers otherwise
    for name in ("attn1.to_q", "attn1.to_k", "attn1.to_v"):
        yield from _linear(cfg, name, size.batch * tokens, dim, dim, input_grad)
    yield _attention(size, dim, tokens)
    yield from _linear(cfg, "attn1.to_out.0", size.batch * tokens, dim, dim, True)
    yield from _linear(cfg, "attn2.to_q", size.batch * tokens, dim, dim, True)
    for name in ("attn2.to_k", "attn2.to_v"):
        yield from _linear(cfg, name, size.batch * TEXT_TOKENS, dim, dim, context_grad)
    yield _attention(size, dim, TEXT_TOKENS)
    if cfg.image_dim:
        for name in ("attn2.add_k_proj", "attn2.add_v_proj"):
            yield from _linear(cfg, name, size.batch * IMAGE_TOKENS, dim, dim, context_grad)
        yield _attention(size, dim, IMAGE_TOKENS)
    yield from _linear(cfg, "attn2.to_out.0", size.batch * tokens, dim, dim, True)
    yield from _linear(cfg, "ffn.net.0.proj", size.batch * tokens, dim, cfg.ffn_dim, True)
    yield from _linear(cfg, "ffn.net.2", size.batch * tokens, cfg.ffn_dim, dim, True)


def _attention(size: Size, dim: int, keys: int) -> Product:
    """Attention of all tokens to `keys` others: scores, and the weighted sum of values."""
    part = "attention" if keys == size.tokens else "cross"
    return Product(part, "block", 4.0 * size.batch * size.tokens * keys * dim, ATTENTION_BACKWARD)


def _linear(cfg: Model, name: str, rows: int, inner: int, columns: int, input_grad: bool) -> Iterator[Product]:
    """A linear layer of a block, with its adapter if it has one.

    The gradient of its input is a product, that of its weight another one unless it is frozen.
    """
    yield Product("linear", "block", 2.0 * rows * inner * columns, input_grad + (cfg.train == "full"))
    if cfg.train == "lora" and any(name.endswith(target) for target in cfg.lora.targets):
        yield Product("linear", "block", 2.0 * rows * inner * cfg.lora.rank, input_grad + 1)
        yield Product("linear", "block", 2.0 * rows * cfg.lora.rank * columns, 2)
