"""ST-LPIPS (Ghildyal and Liu 2022) of colour: a perceptual distance that bears small shifts; lower is better.

Its weights come in a package on PyPI, so that it works offline. Its numbers are not those of LPIPS.
"""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from fracgen.evaluation import backbones, perceptual
from fracgen.evaluation.weights import Weights, sha256
from fracsim.scene.knob import check, knob

SHA256 = "b356b382f96010f77d085ee8343ecd9fd322d0a56e8de2b2d0549fafcad8b9ee"
"""Of the weights that are published."""


@dataclass(kw_only=True)
class Settings:
    """Where the weights lie, and at which size pictures are compared."""

    weights: str = knob("", "file of the weights; empty = as the environment says, else the package stlpips-pytorch")
    size: int = knob(240, "longer side of the pictures that are compared; larger ones are shrunk, at a quarter of the "
                     "cost for half the side; 0 = as they are", "px", least=0, most=4096)  # fmt: skip
    batch: int = knob(4, "frames that are compared at once", least=1, most=1024)

    def __post_init__(self) -> None:
        check(self, "metric.stlpips")


def _packaged() -> Path | None:
    """The file in the package, which is not imported: it would want torchvision."""
    spec = find_spec("stlpips_pytorch")
    places = spec.submodule_search_locations if spec else None
    return Path(next(iter(places)), "weights", "vST0.0", "alex_shift_tolerant.pth") if places else None


WEIGHTS = Weights("ST-LPIPS, AlexNet", "metric.stlpips.weights", "FRACGEN_STLPIPS", "9.9 MB",
                  "pip install --no-deps stlpips-pytorch==0.0.2", [_packaged])  # fmt: skip


class StLpips(perceptual.PerceptualMetric):
    """See above."""

    name = "stlpips"

    def __init__(self, settings: Settings, file: Path) -> None:
        network = perceptual.load(backbones.shift_tolerant_alexnet(), file)
        super().__init__(network, settings.batch, settings.size)
        digest = sha256(file)
        self._about = {"network": WEIGHTS.title if digest == SHA256 else f"not the published {WEIGHTS.title}",
                       "sha256": digest, "size": settings.size}  # fmt: skip

    def about(self) -> dict[str, Any]:
        """The network, its hash, and the size of the pictures."""
        return dict(self._about)


def build(settings: Settings) -> StLpips:
    """The metric; raises MissingWeightsError without weights, and ValueError for a file that holds others."""
    return StLpips(settings, WEIGHTS.find(settings.weights))
