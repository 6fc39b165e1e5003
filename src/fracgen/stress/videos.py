"""Cases of videos on their way through the VAE into a cache: black maps, constant clips, wild values."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from fracgen import data, vae
from fracgen.config.model import Vae
from fracgen.data import encoding
from fracgen.encode import ENCODE
from fracgen.layout import MAPS
from fracgen.stress.case import Case
from fracgen.stress.place import FRAMES, SIZE, TEXT, VAE
from fracsim.records import Array
from fracsim.sample import Writer, header_of
from fracsim.scene.vocab import Camera, Capture, Output, Scene

LARGE = 1e6
"""A value of a map, far from any that a simulation gives."""


def cases() -> list[Case]:
    """All of them."""
    black = {name: 0.0 for name in MAPS}
    return [
        Case("clips of black maps", lambda p, f: encoded(f, **black)),
        Case("clips of constant colour and maps", lambda p, f: encoded(f, **dict.fromkeys(MAPS, 1.0))),
        Case("maps of 1e6 in one pixel", lambda p, f: encoded(f, spike=LARGE, **black), slow=True),
        Case("a video of one frame", lambda p, f: there_and_back(1, torch.float32)),
        Case("a white video, bfloat16", lambda p, f: there_and_back(FRAMES, torch.bfloat16)),
        Case("a video with NaN", lambda p, f: there_and_back(1, torch.float32, float("nan")), r"video: values"),
        Case("a video above 1", lambda p, f: there_and_back(1, torch.float32, 1.5), r"video: values from .* to 1\.5"),
    ]


def encoded(folder: Path, spike: float = 0.0, **values: float) -> Iterator[Tensor]:
    """All latents of a cache of one clip, whose maps are constant but for one pixel."""
    write(folder / "clips", values, spike)
    cfg = ENCODE.compose(
        f"data={folder / 'clips'}",
        f"width={SIZE}",
        f"height={SIZE}",
        f"frames={FRAMES}",
        *VAE,
        "encoders=tiny",
        f"text_dim={TEXT}",
        f"output.folder={folder / 'latents'}",
        "device=cpu",
    )
    encoding.encode(cfg, vae.load(cfg.vae), torch.device("cpu"))
    clip = data.open(folder / "latents")[0]
    yield from (value.float() for value in (*clip.latents.values(), clip.force, clip.reference, clip.scalars))


def write(folder: Path, values: dict[str, float], spike: float) -> None:
    """A sample of a clip of one colour, whose maps have these values."""
    scene = Scene(capture=Capture(frames=FRAMES, tracks=0, report=False, strip=False),
                  camera=Camera(width=SIZE, height=SIZE))  # fmt: skip
    scene = replace(scene, asset=replace(scene.asset, name="bread"))
    report = {"break_frame": None, "torn_frame": None, "particles": 9, "substeps": 9, "clamped": 0,
              "energy": {"grip_work": 1.0, "gravity_work": 0.0, "unaccounted": 0.0}}  # fmt: skip
    with Writer(header_of(scene), Output(folder=str(folder))) as writer:
        for k in range(FRAMES):
            maps = {name: _map(value, 2 if name == "flow" else 1, spike) for name, value in values.items()}
            writer.add(k, np.full((SIZE, SIZE, 3), 200, np.uint8), np.ones((SIZE, SIZE), np.float32), maps)
        writer.finish(report=report)


def _map(value: float, channels: int, spike: float) -> Array:
    out = np.full((SIZE, SIZE, channels), value, np.float32)
    out[0, 0] += spike
    return out


def there_and_back(frames: int, dtype: torch.dtype, value: float = 1.0) -> Iterator[Tensor]:
    """The latent of a constant video, and the video of it."""
    network = vae.load(Vae(base_dim=4, dim_mult=[1, 1, 1, 1], res_blocks=1, dtype=str(dtype).removeprefix("torch.")))
    latent = network.encode(torch.full((1, 3, frames, SIZE, SIZE), value))
    yield from (latent, network.decode(latent))
