"""Encodings with a stand-in VAE, for the tests of the command and of its cache."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from fracgen.config.encode import EncodeConfig, Latents
from fracgen.config.model import Encoders
from fracgen.data import encoding
from fracgen.data.summary import Summary
from tests.gen.clips import FoldedVae, random_clips, tiny_clips

CPU = torch.device("cpu")


@pytest.fixture(scope="module", name="simulated")
def simulated_fixture(taichi: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four simulated clips, 64 x 64 pixels, 17 frames."""
    return tiny_clips(tmp_path_factory.mktemp("simulated"))


@pytest.fixture(scope="module", name="clips")
def clips_fixture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight clips of random pictures, 32 x 48 pixels, 6 frames; it must not be changed."""
    return random_clips(tmp_path_factory.mktemp("random"))


def cfg(data: Path, folder: Path, **more: Any) -> EncodeConfig:
    sizes = {"width": 32, "height": 48, "frames": 5, "text_dim": 8, "encoders": Encoders(text="words", image="zeros")}
    return EncodeConfig(data=str(data), output=Latents(folder=str(folder), shard_mb=1e-3), **{**sizes, **more})


def run(config: EncodeConfig) -> tuple[Summary, int]:
    """Encode with the stand-in VAE: the summary, and how many videos it encoded."""
    folded = FoldedVae()
    return encoding.encode(config, folded, CPU), folded.encoded


def near(latent: Tensor, video: Any) -> bool:
    """Whether a cached latent is that of a video [F, h, w, 3] in [0, 1], rounded to bfloat16."""
    frames = torch.from_numpy(np.ascontiguousarray(video, dtype=np.float32)).permute(3, 0, 1, 2)[None]
    return torch.equal(latent, FoldedVae().encode(frames)[0].bfloat16())
