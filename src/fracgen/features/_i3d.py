"""The I3D network of FVD: Inception-v1 inflated to three dimensions (Carreira and Zisserman 2017, arXiv:1705.07750).

Batch normalisation is folded into the convolutions, padding is TensorFlow's SAME, and the features are the 400 logits
of Kinetics-400 before the softmax, as Unterthiner et al. (2018, arXiv:1812.01717) define FVD.
"""

from collections import OrderedDict
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

SIZE = 224
"""Height and width of the frames that the network sees [px]."""
LEAST = 9
"""Fewest frames: three layers halve them, rounding up, and the last average takes two."""
CLASSES = 400
BLOCKS = {
    "Mixed_3b": (192, 64, 96, 128, 16, 32, 32),
    "Mixed_3c": (256, 128, 128, 192, 32, 96, 64),
    "MaxPool3d_4a_3x3": (3,),
    "Mixed_4b": (480, 192, 96, 208, 16, 48, 64),
    "Mixed_4c": (512, 160, 112, 224, 24, 64, 64),
    "Mixed_4d": (512, 128, 128, 256, 24, 64, 64),
    "Mixed_4e": (512, 112, 144, 288, 32, 64, 64),
    "Mixed_4f": (528, 256, 160, 320, 32, 128, 128),
    "MaxPool3d_5a_2x2": (2,),
    "Mixed_5b": (832, 256, 160, 320, 32, 128, 128),
    "Mixed_5c": (832, 384, 192, 384, 48, 128, 128),
}
"""Channels of the Inception blocks, (in, b0, b1a, b1b, b2a, b2b, b3b), and kernels of the pools of stride 2 between."""


def padding(shape: Sequence[int], kernel: Sequence[int], stride: Sequence[int]) -> list[tuple[int, int]]:
    """TensorFlow's SAME padding before and after each axis: ceil(n / stride) outputs, an odd one is added behind."""
    out = []
    for n, k, s in zip(shape, kernel, stride, strict=True):
        lacking = max((-(-n // s) - 1) * s + k - n, 0)
        out.append((lacking // 2, lacking - lacking // 2))
    return out


def _padded(x: Tensor, pads: Sequence[tuple[int, int]], value: float = 0.0) -> Tensor:
    """Values (B, C, T, H, W) with a border; torch counts axes from the last one."""
    return functional.pad(x, [width for pad in reversed(pads) for width in pad], value=value)


class Unit(nn.Conv3d):
    """A convolution with SAME padding, and a ReLU unless told otherwise."""

    def __init__(self, channels: int, out: int, kernel: int, stride: int = 1, relu: bool = True) -> None:
        super().__init__(channels, out, kernel, stride)
        self.relu = relu

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, T, H, W) -> (B, out, T / stride, H / stride, W / stride)."""
        pads = padding(x.shape[2:], self.kernel_size, self.stride)
        if all(before == after for before, after in pads):  # no copy of the input
            x = functional.conv3d(x, self.weight, self.bias, self.stride, tuple(before for before, _ in pads))
        else:
            x = functional.conv3d(_padded(x, pads), self.weight, self.bias, self.stride)
        return functional.relu_(x) if self.relu else x


class Pool(nn.Module):
    """A maximum with SAME padding."""

    def __init__(self, kernel: Sequence[int], stride: Sequence[int]) -> None:
        super().__init__()
        self.kernel, self.stride = tuple(kernel), tuple(stride)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, T, H, W) -> (B, C, T / stride, H / stride, W / stride)."""
        x = _padded(x, padding(x.shape[2:], self.kernel, self.stride), -torch.inf)
        return functional.max_pool3d(x, self.kernel, self.stride)


class Mixed(nn.Module):
    """An Inception block: four branches, side by side in the channels."""

    def __init__(self, channels: int, b0: int, b1a: int, b1b: int, b2a: int, b2b: int, b3b: int) -> None:
        super().__init__()
        self.b0 = Unit(channels, b0, 1)
        self.b1a, self.b1b = Unit(channels, b1a, 1), Unit(b1a, b1b, 3)
        self.b2a, self.b2b = Unit(channels, b2a, 1), Unit(b2a, b2b, 3)
        self.b3a, self.b3b = Pool((3, 3, 3), (1, 1, 1)), Unit(channels, b3b, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, T, H, W) -> (B, b0 + b1b + b2b + b3b, T, H, W)."""
        return torch.cat([self.b0(x), self.b1b(self.b1a(x)), self.b2b(self.b2a(x)), self.b3b(self.b3a(x))], 1)


class I3D(nn.Module):
    """The network; its layers have the names of the published checkpoints."""

    def __init__(self) -> None:
        super().__init__()
        layers: OrderedDict[str, nn.Module] = OrderedDict()
        layers["Conv3d_1a_7x7"] = Unit(3, 64, 7, 2)
        layers["MaxPool3d_2a_3x3"] = Pool((1, 3, 3), (1, 2, 2))
        layers["Conv3d_2b_1x1"] = Unit(64, 64, 1)
        layers["Conv3d_2c_3x3"] = Unit(64, 192, 3)
        layers["MaxPool3d_3a_3x3"] = Pool((1, 3, 3), (1, 2, 2))
        for name, sizes in BLOCKS.items():
            layers[name] = Mixed(*sizes) if name.startswith("Mixed") else Pool(sizes * 3, (2, 2, 2))
        self.layers = nn.Sequential(layers)
        self.average = nn.AvgPool3d((2, 7, 7), stride=1)
        self.logits = Unit(1024, CLASSES, 1, relu=False)

    def units(self) -> dict[str, Unit]:
        """The convolutions by the names that checkpoints give them, as Mixed_3b.b1a."""
        return {
            name.removeprefix("layers."): module for name, module in self.named_modules() if isinstance(module, Unit)
        }

    def forward(self, frames: Tensor) -> Tensor:
        """Frames (B, 3, T, 224, 224) in [-1, 1], at least 9 of them, to logits (B, 400), averaged over time."""
        return self.logits(self.average(self.layers(frames))).mean((2, 3, 4))  # type: ignore[no-any-return]
