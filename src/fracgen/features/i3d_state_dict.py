"""I3D with the weights of `i3d_pretrained_400.pt`, the state dict that TATS, VideoGPT and cd-fvd use."""

from dataclasses import dataclass

from fracgen.evaluation.weights import Weights, sha256
from fracgen.features import _i3d, _i3d_files
from fracgen.features._video import VideoFeatures
from fracgen.vae.fit import device
from fracsim.scene.knob import check, knob

TITLE = "I3D of Kinetics-400 (i3d_pretrained_400.pt)"


@dataclass(kw_only=True)
class Settings:
    """Where the weights lie and where the network runs."""

    weights: str = knob("", "file of the weights")
    device: str = knob("auto", "where the network runs", choices=("auto", "cpu", "cuda", "mps"))
    section: str = knob("metric.fvd", "section of the configuration that these fields belong to")

    def __post_init__(self) -> None:
        check(self, self.section)


def build(settings: Settings) -> VideoFeatures:
    """The network; raises MissingWeightsError without weights, ValueError for another file."""
    weights = Weights(TITLE, f"{settings.section}.weights", "FRACGEN_I3D_STATE_DICT", "51 MB",
                      "it lies in the repository songweige/TATS")  # fmt: skip
    path = weights.find(settings.weights)
    to = device(settings.device)
    facts = {"network": TITLE, "weights": path.name, "sha256": sha256(path)}
    return VideoFeatures(_i3d_files.state_dict(path).to(to), _i3d.SIZE, _i3d.LEAST, to, facts)
