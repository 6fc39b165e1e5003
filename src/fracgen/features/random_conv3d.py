"""A small network of random weights, for tests and quick looks; its distances rank nothing and are no FVD."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from fracgen.features._video import VideoFeatures
from fracgen.vae.fit import device
from fracsim.scene.knob import check, knob

SIZE, CHANNELS, FEATURES = 64, 16, 64


@dataclass(kw_only=True)
class Settings:
    """Which weights, and where the network runs."""

    seed: int = knob(0, "seed of the weights", least=0, most=2**31 - 1)
    device: str = knob("auto", "where the network runs", choices=("auto", "cpu", "cuda", "mps"))

    def __post_init__(self) -> None:
        check(self, "random_conv3d")


class RandomConv3d(nn.Module):
    """Two convolutions, ReLU, and the mean over time and space."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.first = nn.Conv3d(3, CHANNELS, (3, 7, 7), (1, 4, 4), (1, 3, 3))
        self.second = nn.Conv3d(CHANNELS, FEATURES, 3, (1, 2, 2), 1)
        generator = torch.Generator().manual_seed(seed)
        for layer in (self.first, self.second):
            fan_in = layer.weight[0].numel()
            layer.weight.data.normal_(0, (2 / fan_in) ** 0.5, generator=generator)
            layer.bias.data.normal_(0, 0.1, generator=generator)  # type: ignore[union-attr]

    def forward(self, frames: Tensor) -> Tensor:
        """Frames (B, 3, T, 64, 64) in [-1, 1] to features (B, 64)."""
        return self.second(self.first(frames).relu()).relu().mean((2, 3, 4))  # type: ignore[no-any-return]


def build(settings: Settings) -> VideoFeatures:
    """The network."""
    to = device(settings.device)
    with torch.random.fork_rng(devices=[]):  # layers draw weights, which are replaced, from the numbers of all
        network = RandomConv3d(settings.seed)
    facts = {"network": "random convolutions: for tests, no FVD", "seed": settings.seed}
    return VideoFeatures(network.eval().requires_grad_(False).to(to), SIZE, 1, to, facts)
