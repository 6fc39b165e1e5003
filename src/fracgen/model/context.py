"""Cross attention that projects caption and picture once, not once a sampling step.

Their keys and values do not depend on the noise level, so keeping them is exact. (Those of the reference tokens do, so
they are not kept.)
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import torch
from diffusers.models.attention_dispatch import dispatch_attention_fn
from diffusers.models.transformers.transformer_wan import WanAttnProcessor
from torch import Tensor

if TYPE_CHECKING:
    from fracgen.model.transformer import FracTransformer

TEXT_TOKENS, IMAGE_TOKENS = 512, 257
"""Tokens of a caption, padded with zeros, and of a CLIP embedding."""
PROMPTS = 4
"""So many captions are kept at once; guidance needs two."""


class Kept:
    """Last results of functions of tensors, found again by the tensors themselves, not by their values."""

    def __init__(self) -> None:
        self.entries: list[tuple[tuple[Tensor | None, ...], Tensor]] = []

    def get(self, make: Callable[[], Tensor], *tensors: Tensor | None) -> Tensor:
        """What `make` gave when these very tensors, of any shape, were last seen, or gives now."""
        for known, result in self.entries:
            if all(a is b for a, b in zip(known, tensors, strict=True)):
                return result
        result = make()
        self.entries = [*self.entries[1 - PROMPTS :], (tensors, result)]
        return result


class KeptAttention(WanAttnProcessor):
    """Wan's cross attention, which keeps the keys and values of what it looks at."""

    def __init__(self, like: WanAttnProcessor) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._attention_backend = like._attention_backend
        self.kept = Kept()

    def __call__(self, attn: Any, hidden_states: Tensor, encoder_hidden_states: Tensor, *_: None) -> Tensor:  # type: ignore[override]
        """Tokens [B, L, D] that have looked at `encoder_hidden_states` [B, 512 or 257 + 512, D]."""
        ready = self.kept.get(lambda: _keys_values(attn, encoder_hidden_states), encoder_hidden_states)
        query = attn.norm_q(attn.to_q(hidden_states))
        parts = [ready] if attn.add_k_proj is None else [ready[:, -TEXT_TOKENS:], ready[:, :-TEXT_TOKENS]]
        seen = [self._look(attn.heads, query, *part.chunk(2, dim=-1)) for part in parts]
        out: Tensor = attn.to_out[1](attn.to_out[0](sum(seen)))
        return out

    def _look(self, heads: int, *query_key_value: Tensor) -> Tensor:
        """Attention [B, L, D] of a query [B, L, D] to keys and values [B, N, D]."""
        query, key, value = (x.reshape(*x.shape[:2], heads, -1) for x in query_key_value)
        out: Tensor = dispatch_attention_fn(query, key, value, backend=self._attention_backend)
        return out.flatten(2, 3).type_as(query_key_value[0])


def _keys_values(attn: Any, context: Tensor) -> Tensor:
    """Keys beside values, [B, N, 2 D], of `context` [B, N, D]: the image's tokens first, if there is that branch."""
    if attn.add_k_proj is None:
        return torch.cat([attn.norm_k(attn.to_k(context)), attn.to_v(context)], dim=-1)
    image, text = context[:, :-TEXT_TOKENS], context[:, -TEXT_TOKENS:]
    keys = torch.cat([attn.norm_added_k(attn.add_k_proj(image)), attn.norm_k(attn.to_k(text))], dim=1)
    return torch.cat([keys, torch.cat([attn.add_v_proj(image), attn.to_v(text)], dim=1)], dim=-1)


@contextmanager
def reused(transformer: "FracTransformer") -> Iterator[None]:
    """Keep what depends only on caption and picture while this lasts; see `FracTransformer.reuse_context`."""
    if transformer.training:
        raise ValueError("reuse_context is for sampling: call eval() first; in training captions and weights change.")
    layers: list[Any] = [block.attn2 for block in transformer.blocks]
    processors = [layer.processor for layer in layers]
    transformer.kept = Kept()
    for layer in layers:
        layer.set_processor(KeptAttention(layer.processor))
    try:
        yield
    finally:
        transformer.kept = None
        for layer, processor in zip(layers, processors, strict=True):
            layer.set_processor(processor)
