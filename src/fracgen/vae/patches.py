"""A small VAE with the interface and the layout of Wan's, that works on patches of 4 frames x 8 x 8 pixels.

A latent is the projection of a patch on its principal components, and a decoded patch is their sum, each plus what a
few causal convolutions at the latent's resolution add, which is nothing at first. So it is a linear codec from the
start, and as nothing is computed at full resolution it costs little.
"""

from typing import Any

import numpy as np
import torch
from diffusers import AutoencoderKLWan
from diffusers.models.autoencoders.autoencoder_kl_wan import WanCausalConv3d, WanResidualBlock, WanRMS_norm
from torch import Tensor, nn
from torch.nn import functional

from fracgen.layout import CHANNELS, SPACE, TIME

VALUES = 3 * TIME * SPACE * SPACE
"""Of a patch."""
SMOOTHNESS = 0.95
"""Correlation of neighbouring pixels, frames and colours that the first components are made for, before any data."""


class PatchVae(AutoencoderKLWan):
    """AutoencoderKLWan, with its chunks, tiles and posterior, but another encoder and decoder.

    Its `base_dim` is the width of all layers; `dim_mult` is not used.
    """

    def __init__(self, **sizes: Any) -> None:
        with torch.device("meta"):  # Wan's encoder and decoder are not needed
            super().__init__(**sizes)  # type: ignore[no-untyped-call]
        width, blocks = sizes["base_dim"], sizes["num_res_blocks"]
        self.encoder, self.decoder = Encoder(width, blocks), Decoder(width, blocks + 1)
        self.quant_conv = WanCausalConv3d(2 * CHANNELS, 2 * CHANNELS, 1)
        self.post_quant_conv = WanCausalConv3d(CHANNELS, CHANNELS, 1)
        whole: list[Any] = [self.quant_conv, self.post_quant_conv]
        for conv in whole:
            nn.init.dirac_(conv.weight)
            nn.init.zeros_(conv.bias)
        halves = {"encoder": self.encoder, "decoder": self.decoder}
        self._cached_conv_counts = {name: sum(isinstance(part, WanCausalConv3d) for part in half.modules())
                                    for name, half in halves.items()}  # fmt: skip

    @torch.no_grad()
    def use(self, mean: Tensor, components: Tensor, deviations: Tensor) -> None:
        """Make the linear part that of a `mean` patch [768], orthonormal `components` [768, 16] and their deviations.

        The latent of a patch p is components^T (p - mean) / deviations.
        """
        into = (components / deviations).T
        self.encoder.linear.weight.copy_(into[..., None, None, None])
        self.encoder.linear.bias.copy_(-into @ mean)
        self.decoder.linear.weight.copy_((components * deviations)[..., None, None, None])
        self.decoder.linear.bias.copy_(mean)


class _Trunk(nn.Module):
    """What the neighbours add: causal residual blocks over patches; its last layer gives 0 at first."""

    def __init__(self, channels: int, width: int, blocks: int, out: int) -> None:
        super().__init__()
        self.conv_in = nn.Conv3d(channels, width, 1)
        self.blocks = nn.ModuleList(WanResidualBlock(width, width) for _ in range(blocks))
        self.norm_out = WanRMS_norm(width, images=False)
        self.conv_out = nn.Conv3d(width, out, 1)
        for weight in self.conv_out.parameters():
            nn.init.zeros_(weight)

    def forward(self, x: Tensor, feat_cache: list[Any], feat_idx: list[int]) -> Tensor:
        """What the neighbours add to patches [B, C, T, H, W]; `feat_cache` holds those of the chunks before."""
        x = self.conv_in(x)
        for block in self.blocks:
            x = block(x, feat_cache=feat_cache, feat_idx=feat_idx)
        out: Tensor = self.conv_out(functional.silu(self.norm_out(x)))
        return out


class Encoder(nn.Module):
    """Chunks [B, 3, 1 or 4 n, h, w] to means and log variances [B, 32, 1 or n, h / 8, w / 8]."""

    def __init__(self, width: int, blocks: int) -> None:
        super().__init__()
        self.linear: Any = nn.Conv3d(VALUES, CHANNELS, 1)
        self.trunk = _Trunk(VALUES, width, blocks, 2 * CHANNELS)

    def forward(self, x: Tensor, feat_cache: list[Any], feat_idx: list[int]) -> Tensor:
        """Encode one chunk; `feat_cache` holds the last patches of the chunks before, any shape."""
        patches = cut(x)
        linear = functional.pad(self.linear(patches), (0, 0) * 3 + (0, CHANNELS))
        out: Tensor = linear + self.trunk(patches, feat_cache, feat_idx)
        return out


class Decoder(nn.Module):
    """Latents [B, 16, T, H, W] to chunks [B, 3, 4 T, 8 H, 8 W], of which the first chunk of a clip keeps one frame."""

    def __init__(self, width: int, blocks: int) -> None:
        super().__init__()
        self.linear: Any = nn.Conv3d(CHANNELS, VALUES, 1)
        self.trunk = _Trunk(CHANNELS, width, blocks, VALUES)

    def forward(self, x: Tensor, feat_cache: list[Any], feat_idx: list[int], first_chunk: bool = False) -> Tensor:
        """Decode one chunk; `feat_cache` holds the last latents of the chunks before, any shape."""
        frames = join(self.linear(x) + self.trunk(x, feat_cache, feat_idx))
        return frames[:, :, TIME - 1 :] if first_chunk else frames


def cut(x: Tensor) -> Tensor:
    """Patches [B, 768, n, h / 8, w / 8] of frames [B, 3, 4 n, h, w]; a single frame stands still for four."""
    if x.shape[2] == 1:
        x = x.expand(-1, -1, TIME, -1, -1)
    b, _, f, h, w = x.shape
    parts = x.reshape(b, 3, f // TIME, TIME, h // SPACE, SPACE, w // SPACE, SPACE)
    return parts.permute(0, 1, 3, 5, 7, 2, 4, 6).reshape(b, VALUES, f // TIME, h // SPACE, w // SPACE)


def join(patches: Tensor) -> Tensor:
    """The inverse of `cut`, any shape."""
    b, _, t, h, w = patches.shape
    parts = patches.reshape(b, 3, TIME, SPACE, SPACE, t, h, w).permute(0, 1, 5, 2, 6, 3, 7, 4)
    return parts.reshape(b, 3, t * TIME, h * SPACE, w * SPACE)


def principal(patches: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Mean [768], 16 principal components [768, 16] and their deviations of patches [n, 768]."""
    mean = patches.mean(dim=0)
    values, vectors = torch.linalg.eigh((patches - mean).T @ (patches - mean) / len(patches))
    return mean, *_largest(values, vectors)


def smooth() -> tuple[Tensor, Tensor, Tensor]:
    """The same of pixels in [-1, 1] whose correlation falls exponentially with distance: nearly cosines, any shape.

    The covariance is a Kronecker product, and so are its eigenvectors. Digits beyond float32 are cut, so that machines
    and numbers of threads agree: the hash of the weights names a cache.
    """
    values, vectors = np.ones(1), np.ones((1, 1))
    for size in (3, TIME, SPACE, SPACE):
        place = np.arange(size)
        axis_values, axis_vectors = np.linalg.eigh(SMOOTHNESS ** np.abs(place[:, None] - place))
        axis_vectors *= np.sign(axis_vectors[0])
        values, vectors = np.kron(values, axis_values), np.kron(vectors, axis_vectors)
    rising = np.argsort(values.round(9), kind="stable")
    ordered = (torch.from_numpy(part.round(7)).float() for part in (values[rising] / 4, vectors[:, rising]))
    return torch.zeros(VALUES), *_largest(*ordered)


def _largest(values: Tensor, vectors: Tensor) -> tuple[Tensor, Tensor]:
    """The last 16 `vectors` and the roots of their `values`."""
    return vectors[:, -CHANNELS:].flip(1), values[-CHANNELS:].flip(0).clamp(min=1e-6).sqrt()
