"""Frames as feature networks take them, and the vector of one clip."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from fracsim.records import Array

AT_ONCE = 16
"""Frames that are resized at once, which bounds the memory of long clips."""
RESIZE = "bilinear, align_corners=False, no low pass, squashed"


def frames(video: Array, size: int, device: torch.device | str = "cpu") -> Tensor:
    """A video (T, H, W, 3) uint8 as (1, 3, T, size, size) float32 in [-1, 1].

    As published implementations of FVD do, frames are squashed to a square and enlarged or reduced bilinearly between
    centres of pixels, without a low pass before a reduction.
    """
    out = torch.empty(1, 3, len(video), size, size, device=device)
    for begin in range(0, len(video), AT_ONCE):
        part = torch.tensor(video[begin : begin + AT_ONCE], device=device).permute(0, 3, 1, 2).float()
        part = functional.interpolate(part, (size, size), mode="bilinear", align_corners=False, antialias=False)
        out[0, :, begin : begin + AT_ONCE] = part.transpose(0, 1)
    return out.mul_(2 / 255).sub_(1)


def strided(frames: int, wanted: int) -> Array | None:
    """Indices (wanted,) of frames from the first on, the largest constant stride apart; None where there are fewer.

    A constant stride keeps uniform motion uniform, as indices spread to both ends and rounded would not.
    """
    if frames < wanted:
        return None
    stride = max((frames - 1) // max(wanted - 1, 1), 1)
    return np.arange(wanted) * stride


@dataclass(frozen=True, eq=False)
class VideoFeatures:
    """A network that turns a clip into a vector."""

    network: Callable[[Tensor], Tensor]
    """From frames (1, 3, T, size, size) in [-1, 1] to features (1, D)."""
    size: int
    least: int
    """Fewest frames that the network takes."""
    device: torch.device
    facts: Mapping[str, Any]
    """What the network is: its title, the file and the sha256 of its weights."""

    def about(self) -> dict[str, Any]:
        """The weights, and how frames are prepared."""
        return {**self.facts, "size": self.size, "resize": RESIZE, "values": "[-1, 1]"}

    def __call__(self, video: Array) -> Array:
        """Features (D,) float64 of a video (T, H, W, 3) uint8, computed in float32 whatever surrounds the call."""
        with torch.inference_mode(), torch.autocast(self.device.type, enabled=False), \
                torch.backends.cudnn.flags(allow_tf32=False):  # fmt: skip
            return self.network(frames(video, self.size, self.device))[0].double().cpu().numpy()
