"""Random numbers that belong to a sample, not to a process: keyed by (seed, epoch, sample, purpose).

Two processes draw what one would have drawn, and a run that goes on draws what it would have drawn anyway. (Lightning
seeds all ranks alike, and restores no generator of a worker.)
"""

import hashlib
from operator import index

import torch
from torch import Tensor


def generator(*key: int | str) -> torch.Generator:
    """A generator on the CPU for a key, as (seed, epoch, sample, "noise"); equal keys give equal numbers.

    Whole numbers may be those of NumPy or of a tensor.
    """
    plain = (part if isinstance(part, str) else index(part) for part in key)
    digest = hashlib.blake2b("\0".join(map(repr, plain)).encode(), digest_size=8).digest()
    return torch.Generator().manual_seed(int.from_bytes(digest, "little") >> 1)


def normal(shape: tuple[int, ...], *key: int | str) -> Tensor:
    """Standard normal numbers of any shape, float32."""
    return torch.randn(shape, generator=generator(*key))


def uniform(*key: int | str) -> float:
    """A number in [0, 1)."""
    return float(torch.rand((), dtype=torch.float64, generator=generator(*key)))
