"""A VAE that is used, not trained: pixels in [0, 1], latents of mean near 0 and deviation near 1."""

from typing import Any

import torch
from torch import Tensor, nn

from fracgen import weights
from fracgen.config.model import Vae
from fracgen.layout import CHANNELS, latent_frames, latent_size
from fracgen.vae.network import SIZES, STATISTICS, build

OVERLAP = 4
"""Neighbouring tiles overlap by this part of their edge, over which one is blended into the other."""


class FrozenVae:
    """Encodes clips and decodes latents, one clip after the other, so that a clip's latent never depends on its batch.

    Shapes: B clips, F = 1 + 4 (T - 1) frames, h = 8 H rows and w = 8 W columns of pixels.
    """

    def __init__(self, network: Any, tile: int = 0, dtype: torch.dtype = torch.float32) -> None:
        """Take over `network`, an AutoencoderKLWan; `tile` [px] is the edge of tiles that are decoded one by one."""
        about = [(name, network.config[name]) for name in (*SIZES.values(), *STATISTICS)]
        self.identity: str = weights.digest(network.state_dict(), about)
        """12 hex digits over weights, sizes and latent statistics; equal whatever `tile` and `dtype` are."""
        self.network = nn.Module.to(network, dtype).eval().requires_grad_(False)
        shape = (1, CHANNELS, 1, 1, 1)
        self.mean = torch.tensor(network.config.latents_mean, device=network.device).reshape(shape)
        self.std = torch.tensor(network.config.latents_std, device=network.device).reshape(shape)
        if tile:
            stride = tile - tile // OVERLAP
            network.enable_tiling(tile, tile, stride, stride)
        self._tiled = bool(tile)

    @torch.no_grad()
    def encode(self, video: Tensor) -> Tensor:
        """Latents [B, 16, T, H, W] float32 of clips [B, 3, F, h, w] in [0, 1]: modes of the posterior, normalised.

        Frame k of a latent depends on frames up to 4 k only. Raises ValueError for values outside [0, 1], for another
        number of frames than 1 + 4 n, and for sizes that are not multiples of 16.
        """
        _check(video)
        self.network.use_tiling = False  # a cached latent is that of the whole picture
        return torch.cat([self._encode(video[k : k + 1]) for k in range(len(video))])

    def _encode(self, clip: Tensor) -> Tensor:
        pixels = (2 * clip - 1).to(self.network.device, self.network.dtype)
        mode: Tensor = self.network.encode(pixels).latent_dist.mode().float()
        return (mode - self.mean) / self.std

    @torch.no_grad()
    def decode(self, latent: Tensor) -> Tensor:
        """Clips [B, 3, F, h, w] float32 in [0, 1] of latents [B, 16, T, H, W]."""
        if latent.ndim != 5 or latent.shape[1] != CHANNELS:
            raise ValueError(f"latent: shape {list(latent.shape)} must be [clips, {CHANNELS}, frames, rows, columns].")
        self.network.use_tiling = self._tiled
        return torch.cat([self._decode(latent[k : k + 1]) for k in range(len(latent))])

    def _decode(self, latent: Tensor) -> Tensor:
        z = latent.to(self.mean) * self.std + self.mean
        pixels: Tensor = self.network.decode(z.to(self.network.dtype)).sample.float()
        return ((pixels + 1) / 2).clamp(0, 1)


def _check(video: Tensor) -> None:
    """Raise ValueError for a tensor that is no batch of clips in [0, 1]."""
    if video.ndim != 5 or video.shape[1] != 3 or not len(video):
        raise ValueError(f"video: shape {list(video.shape)} must be [clips, 3, frames, rows, columns].")
    latent_frames(video.shape[2])
    latent_size(video.shape[4], video.shape[3])
    least, most = (float(value) for value in video.aminmax())
    if not (least >= 0 and most <= 1):
        raise ValueError(
            f"video: values from {least:g} to {most:g} must lie in [0, 1]: divide uint8 by 255, and do not scale to "
            "[-1, 1], which encode does."
        )


def load(cfg: Vae, device: torch.device | str = "cpu") -> FrozenVae:
    """The VAE of a configuration on a device; raises ValueError for weights that are missing or do not fit."""
    return FrozenVae(build(cfg).to(device), cfg.tile, getattr(torch, cfg.dtype))
