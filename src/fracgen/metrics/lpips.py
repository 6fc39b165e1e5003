"""LPIPS 0.1 (Zhang et al. 2018) of colour: a perceptual distance by AlexNet or VGG16; lower is better.

The heads come with torchmetrics, the network does not come with any package. `alex` is what most tables print, `vgg` is
meant as a loss; their numbers differ and are not to be compared.
"""

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torchmetrics

from fracgen.evaluation import backbones, perceptual
from fracgen.evaluation.weights import Weights, sha256
from fracsim.scene.knob import check, knob

HEADS = Path(torchmetrics.__file__).parent / "functional" / "image" / "lpips_models"
FIELD = "metric.lpips.weights"


@dataclass(kw_only=True)
class Settings:
    """Which network, and where its weights lie."""

    net: str = knob("alex", "the network; alex is what most tables print", choices=("alex", "vgg"))
    weights: str = knob("", "file of the network's weights; empty = as the environment says, else torch's cache")
    batch: int = knob(4, "frames that are compared at once", least=1, most=1024)

    def __post_init__(self) -> None:
        check(self, "metric.lpips")


def _cached(name: str) -> Path:
    """A file in the cache of torch.hub, found without asking it, since that would make the folder."""
    home = os.environ.get("TORCH_HOME") or Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "torch"
    return Path(home).expanduser() / "hub" / "checkpoints" / name


def _weights(title: str, variable: str, size: str, name: str) -> Weights:
    """Weights that torchvision publishes; their names hold the first digits of their sha256."""
    source = f"download https://download.pytorch.org/models/{name} to {_cached(name).parent}"
    return Weights(title, FIELD, variable, size, source, [partial(_cached, name)])


NETS = {
    "alex": (backbones.alexnet, "AlexNet of ImageNet", "FRACGEN_LPIPS_ALEX", "244 MB", "alexnet-owt-7be5be79.pth"),
    "vgg": (backbones.vgg16, "VGG16 of ImageNet", "FRACGEN_LPIPS_VGG", "553 MB", "vgg16-397923af.pth"),
}
"""Network, title, environment variable, size of the file and its name."""


class Lpips(perceptual.PerceptualMetric):
    """See above."""

    name = "lpips"

    def __init__(self, settings: Settings, file: Path) -> None:
        backbone, title, *_, name = NETS[settings.net]
        super().__init__(perceptual.load(backbone(), file, HEADS / f"{settings.net}.pth"), settings.batch)
        digest = sha256(file)
        published = digest.startswith(Path(name).stem.rpartition("-")[2])
        self._about = {"network": title if published else f"not the published {title}", "sha256": digest,
                       "heads": "LPIPS 0.1"}  # fmt: skip

    def about(self) -> dict[str, Any]:
        """The network and its hash."""
        return dict(self._about)


def build(settings: Settings) -> Lpips:
    """The metric; raises MissingWeightsError without weights, and ValueError for a file that holds others."""
    return Lpips(settings, _weights(*NETS[settings.net][1:]).find(settings.weights))
