"""Learned perceptual distance of two pictures (Zhang et al. 2018): compared are the features of a network.

At each layer l features of unit length a pixel are subtracted, squared, weighted by a head w_l and averaged:
sum_l mean_hw w_l . (a_l / |a_l| - b_l / |b_l|)^2.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from fracgen import weights
from fracgen.evaluation.backbones import Backbone
from fracgen.evaluation.per_frame import PerFrame, tensor
from fracsim.records import Array

MEAN, SPREAD = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)
"""Of the channels of ImageNet's pictures in [-1, 1], as LPIPS 0.1 has them."""
LEAST = 1e-10
"""Added to the length of features, so that none is divided by zero."""
LEAST_SIZE = 32
"""Least height and width of pictures that all networks bear [px]."""


class Perceptual(nn.Module):
    """A backbone and its heads."""

    mean: Tensor
    spread: Tensor

    def __init__(self, backbone: Backbone) -> None:
        super().__init__()
        self.net, self.taps = backbone.layers, backbone.taps
        self.heads = nn.ModuleList(nn.Conv2d(width, 1, 1, bias=False) for width in backbone.widths)
        self.register_buffer("mean", torch.tensor(MEAN)[:, None, None], persistent=False)
        self.register_buffer("spread", torch.tensor(SPREAD)[:, None, None], persistent=False)

    def features(self, pictures: Tensor) -> list[Tensor]:
        """Features of unit length of pictures [B, 3, H, W] in [0, 1], a tensor [B, C, h, w] a layer."""
        x = (2 * pictures - 1 - self.mean) / self.spread
        out = []
        for number, layer in enumerate(self.net):
            x = layer(x)
            if number in self.taps:
                out.append(x / (x.square().sum(dim=1, keepdim=True).sqrt() + LEAST))
        return out

    @torch.inference_mode()
    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        """Distances [B] of pictures [B, 3, H, W] in [0, 1]; 0 of equal ones, exactly."""
        pairs = zip(self.features(a), self.features(b), self.heads, strict=True)
        return torch.stack([head((x - y).square()).mean(dim=(1, 2, 3)) for x, y, head in pairs]).sum(dim=0)


class PerceptualMetric(PerFrame):
    """A perceptual distance as a metric; lower is better."""

    better = False

    def __init__(self, network: Perceptual, batch: int, size: int = 0) -> None:
        super().__init__()
        # Frames have their channels last already, and the network of ST-LPIPS is a quarter faster so.
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it
        self.network = network.eval().requires_grad_(False)
        self.batch, self.size = batch, size

    def scores(self, pred: Array, true: Array) -> Array:
        """The distance of each frame of two videos (T, H, W, 3) uint8, (T,).

        Raises ValueError for pictures that are smaller than 32 px.
        """
        parts = range(0, len(pred), self.batch)
        found = [self.network(*(self._pictures(video[k : k + self.batch]) for video in (pred, true))) for k in parts]
        return np.asarray(torch.cat(found).double().cpu())

    def _pictures(self, frames: Array) -> Tensor:
        """Frames (T, H, W, 3) as the network sees them, [T, 3, h, w]; the longer side shrunk to `size` [px] if any."""
        pictures = tensor(frames, self.device)
        longer = max(pictures.shape[-2:])
        if self.size and longer > self.size:
            height, width = (max(1, round(side * self.size / longer)) for side in pictures.shape[-2:])
            pictures = nn.functional.interpolate(pictures, (height, width), mode="area")
        if min(pictures.shape[-2:]) < LEAST_SIZE:
            height, width = pictures.shape[-2:]
            raise ValueError(f"{self.name}: pictures of {width} x {height} px are too small, {LEAST_SIZE} x "
                             f"{LEAST_SIZE} are needed: make larger ones, or leave out {self.name}.")  # fmt: skip
        return pictures


def renamed(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Weights under the names of `Perceptual`, from those of torchvision's features, of heads, and of both together."""
    rules = ((r"features\.(\d+\.\w+)", r"net.\1"), (r"net\.slice\d\.(\d+\.(?:weight|bias))", r"net.\1"),
             (r"lin(\d)\.model\.1\.weight", r"heads.\1.weight"))  # fmt: skip
    out = {}
    for name, value in tensors.items():
        for pattern, new in rules:
            if re.fullmatch(pattern, name):
                out[re.sub(pattern, new, name)] = value
    return out


def load(backbone: Backbone, *files: Path) -> Perceptual:
    """The network with the weights of these files; raises ValueError naming what does not fit."""
    network = Perceptual(backbone)
    tensors = {name: value for file in files for name, value in renamed(weights.read(file)).items()}
    weights.fit(network, tensors, ", ".join(map(str, files)))
    return network
