"""The schema of `python -m fracgen.train_vae`."""

from dataclasses import dataclass, field

from fracgen.config.model import Vae
from fracsim.scene.knob import check, knob


@dataclass(kw_only=True)
class VaeFolder:
    """Where the weights go."""

    folder: str = knob("vae_tiny", "folder of the weights, in diffusers layout; vae.path takes it")
    overwrite: bool = knob(False, "train again, though the folder holds a VAE or the beginning of another training")

    def __post_init__(self) -> None:
        check(self, "output")


@dataclass(kw_only=True)
class TrainVaeConfig:
    """One training of a VAE on the clips of a data set: colour, maps and the loading's blobs, each a video."""

    data: str = knob("outputs", "folder of a data set of fracsim")
    clips: int = knob(32, "clips that are held in memory, spread over the data set", least=2, most=4096)
    held_out: int = knob(2, "clips among them that are judged, not trained on", least=1, most=1024)
    frames: int = knob(9, "frames of a training crop, 1 + 4 n", least=1, most=257)
    size: int = knob(64, "rows and columns of a training crop", "px", least=16, most=1024)
    batch: int = knob(8, "crops of a step", least=1, most=1024)
    steps: int = knob(200, "optimiser steps", least=1)
    lr: float = knob(
        3e-3, "learning rate after the warm-up; it falls to 0 along a cosine", least=0, open="least", most=1
    )
    warmup: int = knob(10, "optimiser steps until the learning rate is reached", least=0)
    kl: float = knob(1e-6, "weight of the divergence from a standard normal, in nats a value of the latent", least=0)
    edges: float = knob(0.0, "weight of the error of differences between neighbouring pixels", least=0)
    save_steps: int = knob(50, "optimiser steps between checkpoints, from which a repeated command goes on", least=1)
    device: str = knob(
        "auto", "where to train; auto takes a GPU if there is one", choices=("auto", "cpu", "cuda", "mps")
    )
    seed: int = knob(0, "seed of crops and noise", least=0, most=2**31 - 1)
    vae: Vae = field(default_factory=Vae)
    output: VaeFolder = field(default_factory=VaeFolder)

    def __post_init__(self) -> None:
        check(self, "")
        if self.held_out >= self.clips:
            raise ValueError(f"held_out={self.held_out} must be below clips={self.clips}, so that some are trained on.")
