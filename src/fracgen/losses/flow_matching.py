"""Flow matching (Eq. 1 of the paper): the mean squared error of the predicted velocity, stream by stream.

Shapes: B clips, S streams; joint latents are [B, C, T, S H, W].
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from fracgen.layout import STREAMS, split


def per_stream(predicted: Tensor, target: Tensor, streams: Sequence[str]) -> Tensor:
    """Mean squared error of the velocity over C, T, H and W of each clip and stream, [B, S] float32.

    `predicted` and `target` are joint latents [B, C, T, S H, W]; columns follow the order of the joint latent.
    """
    squared = (predicted.float() - target.float()).square()
    return torch.stack([part.mean(dim=(1, 2, 3, 4)) for part in split(squared, streams).values()], dim=1)


def weights(map_weights: Sequence[float], streams: Sequence[str]) -> list[float]:
    """The weights of the streams of a joint latent, which sum to 1, of those of all STREAMS (S,).

    Raises ValueError when all streams of the stage have weight 0.
    """
    given = dict(zip(STREAMS, map_weights, strict=True))
    chosen = [given[name] for name in STREAMS if name in streams]
    if not sum(chosen) > 0:
        raise ValueError(f"loss.map_weights={list(map_weights)} leaves nothing to learn: give one of the streams "
                         f"{', '.join(streams)} a weight above 0.")  # fmt: skip
    return [w / sum(chosen) for w in chosen]


def weighted(errors: Tensor, shares: Sequence[float]) -> Tensor:
    """The weighted mean over streams of errors [B, S], [B]; `shares` sum to 1."""
    return errors @ torch.tensor(list(shares), dtype=errors.dtype, device=errors.device)
