"""Captions without weights: a fixed random vector a word, the same in every process and on every machine."""

import math
import re

import torch
from torch import Tensor

from fracgen import draws

END = "</s>"
"""Follows the last word, so that an empty caption has a token."""
POSITION = 0.3
"""Standard deviation of the part that tells the place in the sentence; that of the word's part is 1."""


def identity(dim: int) -> str:
    """What tells these embeddings from others."""
    return f"words-{dim}"


class Words:
    """Random vectors of words plus the sines and cosines of their places (Vaswani et al. 2017, section 3.5)."""

    def __init__(self, dim: int, tokens: int) -> None:
        self.dim, self.tokens = dim, tokens
        self.identity = identity(dim)

    def encode(self, captions: list[str]) -> list[Tensor]:
        """Embeddings [n, dim] float32: a row a word in lower case, and one for the end; at most `tokens` rows."""
        return [self._one(re.findall(r"[a-z0-9][a-z0-9.'-]*", caption.lower())) for caption in captions]

    def _one(self, found: list[str]) -> Tensor:
        found = [*(word.rstrip(".'-") for word in found[: self.tokens - 1]), END]
        rows = torch.stack([draws.normal((self.dim,), "word", word) for word in found])
        rows *= math.sqrt(self.dim) / rows.norm(dim=1, keepdim=True)
        out: Tensor = rows + POSITION * math.sqrt(2) * _places(len(found), self.dim)
        return out


def _places(n: int, dim: int) -> Tensor:
    """Sines, then cosines, of n places with wavelengths from 2 pi to 2e4 pi, [n, dim]."""
    half = (dim + 1) // 2
    angle = torch.arange(n)[:, None] * torch.logspace(0, -4, half)
    return torch.cat([angle.sin(), angle.cos()], dim=1)[:, :dim]
