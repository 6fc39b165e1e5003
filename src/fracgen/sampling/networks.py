"""The networks of a sampling: what they make of requests, and of latents.

Shapes: B requests, F = 1 + 4 (T - 1) frames, h = 8 H rows and w = 8 W columns of pixels, S streams.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor

from fracgen import conditioning, encoders, layout, vae
from fracgen.config.conditioning import Conditioning
from fracgen.config.sample import SampleConfig
from fracgen.denoiser import Inputs
from fracgen.model import trained
from fracgen.model.load import keeps_float32
from fracgen.model.transformer import FracTransformer
from fracgen.sampling.request import Request
from fracgen.sampling.trained_run import TrainedRun
from fracgen.vae import FrozenVae
from fracsim.records import Array


class Captions:
    """Embeddings of captions; the encoder has left the memory before the next network comes."""

    def __init__(self, captions: Iterable[str], cfg: SampleConfig, run: TrainedRun, device: torch.device) -> None:
        wanted = list(dict.fromkeys(captions))
        encoder = encoders.text(cfg.encoders, run.cache["text_dim"], device)
        self._known = dict(zip(wanted, encoder.encode(wanted), strict=True))

    def __call__(self, *captions: str) -> Tensor:
        """Their embeddings, zeros after the end of each, [B, 512, D]."""
        return encoders.pad([self._known[caption] for caption in captions])


class Networks(NamedTuple):
    """All that sampling calls."""

    captions: Captions
    image: encoders.ImageEncoder | None
    """None for a network without that branch, or without that encoder."""
    vae: FrozenVae
    transformer: FracTransformer


def load(requests: Sequence[Request], cfg: SampleConfig, run: TrainedRun, dtype: str, device: torch.device) -> Networks:
    """The networks, after the captions of all requests are encoded.

    Raises ValueError when weights are missing, or are not those of the run.
    """
    decoder = vae.load(cfg.vae, device)
    run.check_vae(decoder.identity)
    captions = Captions([*(request.caption for request in requests), ""], cfg, run, device)
    image = encoders.image(cfg.encoders, device) if run.model.image_dim else None
    return Networks(captions, image, decoder, _transformer(run, getattr(torch, dtype), device))


def _transformer(run: TrainedRun, dtype: torch.dtype, device: torch.device) -> FracTransformer:
    """The network of a run with weights of a type, also those that were trained in float32."""
    network: Any = trained.assemble(run.path, str(device), dtype, run.model)
    for name, parameter in network.named_parameters():
        if not keeps_float32(network, name):
            parameter.data = parameter.data.to(dtype)
    return cast(FracTransformer, network)


def inputs(requests: Sequence[Request], networks: Networks, run: TrainedRun, ranges: str) -> tuple[Inputs, Tensor]:
    """What the network sees of B requests beside the noise, and the latents of the pictures, [B, 16, H, W]."""
    _, height, width = run.size
    encode, pictures = networks.vae.encode, np.stack([request.read() for request in requests])
    force = torch.cat([encode(_video(conditioning.blobs(r.paths, width, height))) for r in requests])
    reference = torch.cat([encode(_video(picture[None] / np.float32(255)))[:, :, 0] for picture in pictures])
    numbers = torch.from_numpy(np.stack([conditioning.scalars(r.condition, ranges) for r in requests]))
    count, how = len(run.streams), Conditioning(**run.about["conditioning"])
    return Inputs(
        channels=conditioning.channels(force, numbers, count, how.height, how.gain),
        reference=layout.pad_reference(reference, count),
        text=networks.captions(*(request.caption for request in requests)),
        image=None if networks.image is None else networks.image.encode(torch.from_numpy(pictures)),
    ), reference


def _video(frames: Array) -> Tensor:
    """Frames in [0, 1], (F, h, w, 3), as the VAE takes them, [1, 3, F, h, w]."""
    return torch.from_numpy(np.ascontiguousarray(frames)).movedim(-1, 0)[None]


def decode(joint: Tensor, wanted: Sequence[str], decoder: FrozenVae, run: TrainedRun) -> Iterator[tuple[str, Array]]:
    """The videos in [0, 1], (F, h, w, 3), of the wanted streams of one joint latent [1, 16, T, S H, W], one by one."""
    parts = layout.split(joint, run.streams)
    for name in wanted:
        yield name, decoder.decode(parts[name])[0].movedim(0, -1).cpu().numpy()
