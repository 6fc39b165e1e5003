"""The joint latent: streams one below the other along the image height. The only file that knows the factor K + 1.

Shapes: B clips, C channels, T latent frames, H and W latent rows and columns of one stream, S streams.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # torch takes seconds to load, and the help of every program needs the names of the streams
    from torch import Tensor

RGB, FLOW, STRAIN, STRESS, DAMAGE = "rgb", "flow", "strain", "stress", "damage"
STREAMS = (RGB, FLOW, STRAIN, STRESS, DAMAGE)
"""Order of the streams from top to bottom, as in the paper."""
MAPS = STREAMS[1:]
SPACE, TIME = 8, 4
"""Pixels a latent row or column, frames a latent frame (Wan2.1's VAE)."""
CHANNELS = 16
"""Channels of a latent."""
PATCH = 2
"""Latent rows and columns a token of the transformer."""
MULTIPLE = SPACE * PATCH
"""Width and height of a picture are multiples of this [px], so that no token straddles two streams."""


def ordered(streams: Sequence[str]) -> tuple[str, ...]:
    """`streams` in the order of the joint latent; raises ValueError for an unknown, double or missing rgb stream."""
    unknown = [name for name in streams if name not in STREAMS]
    if unknown or len(set(streams)) < len(streams) or RGB not in streams:
        raise ValueError(f"streams={list(streams)} is not allowed: name rgb, and any of {', '.join(MAPS)}, each once.")
    return tuple(name for name in STREAMS if name in streams)


def latent_frames(frames: int) -> int:
    """Latent frames of a clip: the first frame alone, then one for TIME frames.

    Raises ValueError unless frames = 1 + 4 n.
    """
    if frames < 1 or (frames - 1) % TIME:
        lower = max(1, (frames - 1) // TIME * TIME + 1)
        raise ValueError(f"frames={frames} must be 1 + 4 n, as 81, since the VAE groups frames 1 + 4 + 4 ...: "
                         f"set frames={lower} or {lower + TIME}.")  # fmt: skip
    return 1 + (frames - 1) // TIME


def latent_size(width: int, height: int) -> tuple[int, int]:
    """Latent columns and rows (W, H) of a picture [px]; raises ValueError unless both are multiples of MULTIPLE."""
    for name, size in (("width", width), ("height", height)):
        if size < MULTIPLE or size % MULTIPLE:
            raise ValueError(f"{name}={size} must be a positive multiple of {MULTIPLE}, as 512, so that no token "
                             "straddles two maps.")  # fmt: skip
    return width // SPACE, height // SPACE


def join(latents: "Mapping[str, Tensor]") -> "Tensor":
    """Latents by stream, [B, C, T, H, W] each, as the joint latent [B, C, T, S H, W]."""
    import torch

    return torch.cat([latents[name] for name in ordered(tuple(latents))], dim=-2)


def split(joint: "Tensor", streams: Sequence[str]) -> "dict[str, Tensor]":
    """The latent [B, C, T, H, W] of each stream of a joint latent [B, C, T, S H, W]; views, the inverse of `join`."""
    assert joint.shape[-2] % len(streams) == 0, (joint.shape, streams)
    return dict(zip(ordered(streams), joint.chunk(len(streams), dim=-2), strict=True))


def pad_reference(reference: "Tensor", streams: int) -> "Tensor":
    """The latent of the object's picture [B, C, H, W] above zeros, [B, C, S H, W]: maps have no reference."""
    import torch

    return torch.cat([reference, *[torch.zeros_like(reference)] * (streams - 1)], dim=-2)
