"""The schema of `python -m fracgen.encode`."""

from dataclasses import dataclass, field

from fracgen.config.model import Encoders, Vae
from fracsim.scene.knob import check, knob

TEXT_DIM = {"umt5": 4096, "words": 64}
"""Channels of a caption's embedding by encoder, where none are asked for."""


@dataclass(kw_only=True)
class Latents:
    """Where the cache lies, and how large its files are."""

    folder: str = knob("latents", "folder of the latent cache; what it holds already is not encoded again")
    shard_mb: float = knob(512.0, "size at which a file is closed", "MiB", least=0, open="least")
    minutes: float = knob(10.0, "age at which a file is closed: a killed process loses no more", "min", least=0.01)

    def __post_init__(self) -> None:
        check(self, "output")


@dataclass(kw_only=True)
class EncodeConfig:
    """One latent cache."""

    data: str = knob("outputs", "folder of the data set, as output.folder of its sweep")
    streams: list[str] = knob(["rgb", "flow", "strain", "stress", "damage"], "what is encoded, rgb among it",
                              choices=("rgb", "flow", "strain", "stress", "damage"))  # fmt: skip
    width: int = knob(512, "picture width; clips of a whole multiple are averaged", "px", least=16, most=8192)
    height: int = knob(512, "picture height", "px", least=16, most=8192)
    frames: int = knob(81, "frames of a clip, 1 + 4 n", least=1, most=4001)
    frame_select: str = knob("head", "which frames of a longer clip: the first, the last, or evenly spread",
                             choices=("head", "tail", "linspace"))  # fmt: skip
    fps: float = knob(0.0, "frames a second of simulated time of the clips; 0 = that of most of them", "1/s", least=0)
    percentile: float = knob(99.5, "flow, strain and stress of a clip are scaled by this percentile of its foreground",
                             least=1, most=100)  # fmt: skip
    ranges: str = knob("warn", "numbers outside the paper's ranges: clamp, clamp and warn, or refuse",
                       choices=("clamp", "warn", "fail"))  # fmt: skip
    text_dim: int = knob(0, "channels of the caption's embedding, as model.text_dim; 0 = 4096 for encoders.text=umt5, "
                         "64 for words", least=0)  # fmt: skip
    suspect: bool = knob(False, "also clips whose numbers are not to be trusted")
    strict: bool = knob(False, "fail when a clip cannot be used, instead of leaving it out")
    verify: bool = knob(False, "only compare all files of the cache with their hashes")
    device: str = knob("auto", "where the networks run", choices=("auto", "cpu", "cuda", "mps"))
    vae: Vae = field(default_factory=Vae)
    encoders: Encoders = field(default_factory=Encoders)
    output: Latents = field(default_factory=Latents)

    def __post_init__(self) -> None:
        from fracgen import layout  # imports torch, which the help does not need

        check(self, "")
        self.streams = list(layout.ordered(self.streams))
        layout.latent_frames(self.frames)
        layout.latent_size(self.width, self.height)
        self.text_dim = self.text_dim or TEXT_DIM[self.encoders.text]
