"""VideoMAE, with the weights of any folder that `transformers` reads: the mean of the tokens of its last layer.

Which checkpoint is given decides what a distance means; a distance of these features is no FVD of I3D. A clip is shown
by as many frames as the network was trained with, a constant stride apart.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from fracgen.evaluation.weights import Weights, sha256
from fracgen.features._video import VideoFeatures, strided
from fracgen.vae.fit import device
from fracsim.scene.knob import check, knob

FILE = "model.safetensors"
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of the colours in [0, 1] that the network was trained with."""


@dataclass(kw_only=True)
class Settings:
    """Where the weights lie and where the network runs."""

    weights: str = knob("", f"folder with config.json and {FILE}, or this file in it")
    device: str = knob("auto", "where the network runs", choices=("auto", "cpu", "cuda", "mps"))
    section: str = knob("metric.fvd", "section of the configuration that these fields belong to")

    def __post_init__(self) -> None:
        check(self, self.section)


def build(settings: Settings) -> VideoFeatures:
    """The network; raises MissingWeightsError without weights, ValueError for those of another network."""
    field = f"{settings.section}.weights"
    weights = Weights("VideoMAE", field, "FRACGEN_VIDEOMAE", "0.1 to 1.2 GB",
                      f"download a folder with {FILE}, as MCG-NJU/videomae-base of Hugging Face")  # fmt: skip
    given = Path(settings.weights).expanduser()
    path = weights.find(str(given / FILE) if settings.weights and given.is_dir() else settings.weights)
    from transformers import VideoMAEModel

    try:
        loaded: Any = VideoMAEModel.from_pretrained(
            path.parent, dtype=torch.float32, local_files_only=True, output_loading_info=True
        )
    except Exception as error:  # of safetensors and others, which have no common base
        raise ValueError(f"{field}={path.parent} is no folder of VideoMAE: {error}") from error
    model, info = loaded
    if info["missing_keys"] or info.get("mismatched_keys"):
        raise ValueError(f"{field}={path.parent} lacks weights of VideoMAE: {sorted(info['missing_keys'])[:3]}.")
    to = device(settings.device)
    model = model.eval().requires_grad_(False).to(to)
    mean, std = (torch.tensor(values, device=to).view(1, 1, 3, 1, 1) for values in (MEAN, STD))

    def features(frames: Tensor) -> Tensor:
        """Frames (1, 3, T, size, size) in [-1, 1] to the mean token (1, D)."""
        chosen = torch.from_numpy(np.asarray(strided(frames.shape[2], model.config.num_frames)))
        colours = (frames[:, :, chosen].transpose(1, 2) + 1) / 2
        return model((colours - mean) / std).last_hidden_state.mean(1)  # type: ignore[no-any-return]

    facts = {"network": f"VideoMAE ({path.parent.name})", "weights": path.name, "sha256": sha256(path)}
    return VideoFeatures(features, model.config.image_size, model.config.num_frames, to, facts)
