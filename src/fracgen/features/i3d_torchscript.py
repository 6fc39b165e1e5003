"""I3D as the TorchScript file of StyleGAN-V and fvd-comparison, `i3d_torchscript.pt`."""

import warnings
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from fracgen.evaluation.weights import Weights, sha256
from fracgen.features import _i3d
from fracgen.features._video import VideoFeatures
from fracgen.vae.fit import device
from fracsim import caching
from fracsim.scene.knob import check, knob

TITLE = "I3D of Kinetics-400 (i3d_torchscript.pt)"


@dataclass(kw_only=True)
class Settings:
    """Where the file lies and where the network runs."""

    weights: str = knob("", "file of the network; empty = i3d_torchscript.pt in the folder fracgen of the user's cache")
    device: str = knob("auto", "where the network runs", choices=("auto", "cpu", "cuda", "mps"))
    section: str = knob("metric.fvd", "section of the configuration that these fields belong to")

    def __post_init__(self) -> None:
        check(self, self.section)


def cached() -> Path:
    """Where the file lies without being told."""
    return caching.base() / "fracgen" / "i3d_torchscript.pt"


def build(settings: Settings) -> VideoFeatures:
    """The network; raises MissingWeightsError without the file, ValueError for one that torch does not load."""
    weights = Weights(TITLE, f"{settings.section}.weights", "FRACGEN_I3D", "49 MB",
                      "the README of StyleGAN-V links it", (cached,))  # fmt: skip
    path = weights.find(settings.weights)
    to = device(settings.device)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of all of torch.jit
            network = torch.jit.load(path, map_location=to).eval()  # type: ignore[no-untyped-call]
    except RuntimeError as error:
        raise ValueError(f"{settings.section}.weights={path} is no TorchScript file: {error}") from error

    def features(frames: Tensor) -> Tensor:
        """Frames (1, 3, T, 224, 224) in [-1, 1] to logits (1, 400); scaling and resizing are done already."""
        return network(frames, rescale=False, resize=False, return_features=True)  # type: ignore[no-any-return]

    facts = {"network": TITLE, "weights": path.name, "sha256": sha256(path)}
    return VideoFeatures(features, _i3d.SIZE, _i3d.LEAST, to, facts)
