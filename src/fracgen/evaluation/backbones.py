"""Convolutional networks whose layers perceptual distances compare, with the numbering of their published weights.

Each is an `nn.Sequential` and the numbers of its layers that are compared.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor, nn


@dataclass(frozen=True)
class Backbone:
    """Layers, and which of their outputs are compared."""

    layers: nn.Sequential
    taps: tuple[int, ...]
    widths: tuple[int, ...]
    """Channels of these outputs."""


def alexnet() -> Backbone:
    """The features of torchvision's AlexNet; outputs of its five ReLUs."""
    conv = nn.Conv2d
    layers = [
        conv(3, 64, 11, 4, 2), nn.ReLU(), nn.MaxPool2d(3, 2),
        conv(64, 192, 5, 1, 2), nn.ReLU(), nn.MaxPool2d(3, 2),
        conv(192, 384, 3, 1, 1), nn.ReLU(), conv(384, 256, 3, 1, 1), nn.ReLU(), conv(256, 256, 3, 1, 1), nn.ReLU(),
    ]  # fmt: skip
    return Backbone(nn.Sequential(*layers), (1, 4, 7, 9, 11), (64, 192, 384, 256, 256))


def vgg16() -> Backbone:
    """The features of torchvision's VGG16; outputs of the last ReLU before each pooling."""
    widths, counts = (64, 128, 256, 512, 512), (2, 2, 3, 3, 3)
    layers = list(_blocks(widths, counts))[:-1]
    return Backbone(nn.Sequential(*layers), (3, 8, 15, 22, 29), widths)


def _blocks(widths: tuple[int, ...], counts: tuple[int, ...]) -> Iterator[nn.Module]:
    """Blocks of convolutions of 3 x 3, each of which ends in a pooling."""
    before = 3
    for width, count in zip(widths, counts, strict=True):
        for _ in range(count):
            yield nn.Conv2d(before, width, 3, 1, 1)
            yield nn.ReLU()
            before = width
        yield nn.MaxPool2d(2, 2)


def shift_tolerant_alexnet() -> Backbone:
    """AlexNet with dense convolutions that are low-passed before they are thinned out (Ghildyal and Liu 2022)."""
    conv, pool = nn.Conv2d, nn.MaxPool2d
    layers = [
        conv(3, 64, 11, 1, 2), BlurPool(), nn.ReLU(), pool(3, 1), BlurPool(),
        conv(64, 192, 5, 1, 2), nn.ReLU(), pool(3, 1), BlurPool(),
        conv(192, 384, 3, 1, 1), nn.ReLU(), conv(384, 256, 3, 1, 1), nn.ReLU(), conv(256, 256, 3, 1, 1), nn.ReLU(),
    ]  # fmt: skip
    return Backbone(nn.Sequential(*layers), (2, 6, 10, 12, 14), (64, 192, 384, 256, 256))


class BlurPool(nn.Module):
    """Every second pixel of a picture that [1, 2, 1] / 4 has blurred along both axes, borders mirrored by 2 px."""

    kernel: Tensor

    def __init__(self) -> None:
        super().__init__()
        weights = torch.tensor([1.0, 2.0, 1.0]) / 4
        self.register_buffer("kernel", torch.outer(weights, weights), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """[B, C, H, W] to [B, C, (H + 1) // 2 + 1, (W + 1) // 2 + 1]."""
        padded, channels = nn.functional.pad(x, (2, 2, 2, 2), mode="reflect"), x.shape[1]
        return nn.functional.conv2d(padded, self.kernel.expand(channels, 1, 3, 3), stride=2, groups=channels)
