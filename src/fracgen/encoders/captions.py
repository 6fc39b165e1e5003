"""The caption as vectors: by UMT5, as the base was trained, or by a fixed random vector a word."""

from collections.abc import Sequence
from typing import Protocol

import torch
from torch import Tensor

from fracgen.config.model import Encoders
from fracgen.encoders import umt5, words

TOKENS = 512
"""Tokens of an embedding as the transformer gets it; the rest after the caption's end is zeros."""


class TextEncoder(Protocol):
    """Encodes captions."""

    identity: str
    """12 hex digits, or a name, that tells this encoder from others."""

    def encode(self, captions: list[str]) -> list[Tensor]:
        """Embeddings [n, dim] float32 on the CPU, n <= TOKENS the true length of each caption."""
        ...


def text(cfg: Encoders, dim: int, device: torch.device | str = "cpu") -> TextEncoder:
    """The encoder of captions with `dim` channels.

    Raises ValueError for weights that are missing or do not fit, and for a UMT5 of another width than `dim`.
    """
    return words.Words(dim, TOKENS) if cfg.text == "words" else umt5.load(cfg, dim, TOKENS, device)


def text_identity(cfg: Encoders, dim: int) -> str:
    """`text(cfg, dim).identity` without loading a network; raises ValueError for weights that are missing."""
    return words.identity(dim) if cfg.text == "words" else umt5.identity(cfg)


def pad(embeddings: Sequence[Tensor]) -> Tensor:
    """Embeddings [n, dim] of captions as one tensor [B, TOKENS, dim], zeros after the end of each."""
    out = embeddings[0].new_zeros(len(embeddings), TOKENS, embeddings[0].shape[-1])
    for row, embedding in zip(out, embeddings, strict=True):
        row[: len(embedding)] = embedding
    return out
