"""The networks of a sampling: what they make of requests, and of latents.

Shapes: B requests, F = 1 + 4 (T - 1) frames, h = 8 H rows and w = 8 W columns of pixels, S streams.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor

from fracgen import conditioning, encoders, layout
from fracgen.config.sample import SampleConfig
from fracgen.denoiser import Inputs, Network
from fracgen.model import trained
from fracgen.sampling.request import Request
from fracgen.sampling.trained_run import TrainedRun
from fracgen.vae import FrozenVae
from fracsim.records import Array


class Embedded(NamedTuple):
    """What the encoders, which are not needed any more, have made of all requests."""

    text: list[Tensor]
    """Embeddings of the captions, [512, D] each."""
    empty: Tensor | None
    """Embedding of the empty caption, [1, 512, D]; None without guidance."""
    image: list[Tensor] | None
    """CLIP embeddings of the pictures, [257, 1280] each."""


def embed(requests: Sequence[Request], cfg: SampleConfig, run: TrainedRun, device: torch.device) -> Embedded:
    """Encode captions and pictures, each once; an encoder leaves the memory before the next network comes."""
    guided = cfg.sampler.guidance != 1
    wanted = list(dict.fromkeys([*(r.caption for r in requests), *([""] if guided else [])]))
    encoder = encoders.text(cfg.encoders, run.cache["text_dim"], device)
    padded = dict(zip(wanted, encoders.pad(encoder.encode(wanted)), strict=True))
    del encoder
    image = encoders.image(cfg.encoders, device) if run.model.image_dim else None
    return Embedded(
        text=[padded[r.caption] for r in requests],
        empty=padded[""][None] if guided else None,
        image=None if image is None else [image.encode(torch.from_numpy(r.pixels)[None])[0] for r in requests],
    )


def transformer(run: TrainedRun, device: torch.device, dtype: torch.dtype) -> Network:
    """The network of a run, ready to sample; raises ValueError when it does not fit its base."""
    network: Any = trained.assemble(run.path, str(device), dtype, run.model)
    return cast(Network, network)


def inputs(
    requests: Sequence[Request], embedded: Embedded, vae: FrozenVae, run: TrainedRun, ranges: str
) -> tuple[Inputs, Tensor]:
    """What the network sees of B requests beside the noise, and the latents of the pictures, [B, 16, H, W]."""
    _, height, width = run.size
    force = torch.cat([vae.encode(_video(conditioning.blobs(r.paths, width, height))) for r in requests])
    reference = torch.cat([vae.encode(_video(r.pixels[None] / np.float32(255)))[:, :, 0] for r in requests])
    numbers = torch.from_numpy(np.stack([conditioning.scalars(r.condition, ranges) for r in requests]))
    count = len(run.streams)
    return Inputs(
        channels=conditioning.channels(force, numbers, count, run.about["conditioning"]["height"]),
        reference=layout.pad_reference(reference, count),
        text=torch.stack(embedded.text),
        image=None if embedded.image is None else torch.stack(embedded.image),
    ), reference


def _video(frames: Array) -> Tensor:
    """Frames in [0, 1], (F, h, w, 3), as the VAE takes them, [1, 3, F, h, w]."""
    return torch.from_numpy(np.ascontiguousarray(frames)).movedim(-1, 0)[None]


def decode(joint: Tensor, wanted: Sequence[str], vae: FrozenVae, run: TrainedRun) -> Iterator[tuple[str, Array]]:
    """The videos in [0, 1], (F, h, w, 3), of the wanted streams of one joint latent [1, 16, T, S H, W], one by one."""
    parts = layout.split(joint, run.streams)
    for name in wanted:
        yield name, vae.decode(parts[name])[0].movedim(0, -1).cpu().numpy()
