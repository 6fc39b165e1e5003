"""How good a VAE is on clips that it has not seen: the error of each stream, latent statistics, a sheet to look at."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from fracgen.layout import CHANNELS
from fracgen.vae.clips import Videos, tensor
from fracgen.vae.frozen import FrozenVae
from fracsim.dataset import progress

COLUMNS = 4
"""Frames of a clip in the sheet."""
_LEAST = 1e-4
"""Least standard deviation of a channel, so that one that is never used is not blown up."""


@torch.no_grad()
def statistics(network: Any, videos: Sequence[Videos]) -> tuple[list[float], list[float]]:
    """Mean and standard deviation of the 16 channels of the latents of all streams of all clips."""
    count, total, square = 0, torch.zeros(CHANNELS).double(), torch.zeros(CHANNELS).double()
    for one in progress.shown(videos, len(videos), "measure latents"):
        for video in one.streams.values():
            pixels = (2 * tensor(video) - 1).to(network.device)
            mode = network.encode(pixels).latent_dist.mode().double().cpu().transpose(0, 1).flatten(1)
            count += mode.shape[1]
            total += mode.sum(dim=1)
            square += mode.square().sum(dim=1)
    mean = total / count
    std = (square / count - mean.square()).clamp(min=_LEAST**2).sqrt()
    return mean.tolist(), std.tolist()


def errors(vae: FrozenVae, videos: Sequence[Videos]) -> dict[str, dict[str, float]]:
    """PSNR [dB] of each stream over all clips, and that of the best single colour, which reconstructs nothing."""
    found: dict[str, list[tuple[float, float]]] = {}
    for one in progress.shown(videos, len(videos), "judge"):
        for name, video in one.streams.items():
            clip = tensor(video)
            error = (vae.decode(vae.encode(clip)).cpu() - clip).square().mean()
            flat = clip - clip.mean(dim=(2, 3, 4), keepdim=True)
            found.setdefault(name, []).append((float(error), float(flat.square().mean())))
    return {name: {"psnr": _psnr([a for a, _ in pairs]), "psnr_of_one_colour": _psnr([b for _, b in pairs])}
            for name, pairs in found.items()}  # fmt: skip


def _psnr(squares: Sequence[float]) -> float:
    """Peak signal to noise ratio [dB] of mean squared errors of pixels in [0, 1]; at most 100."""
    return round(float(-10 * np.log10(max(float(np.mean(squares)), 1e-10))), 2)


def sheet(vae: FrozenVae, videos: Videos, path: Path) -> None:
    """Write a picture: for each stream a row of original frames, and below it a row of their reconstructions."""
    rows: list[Tensor] = []
    for video in videos.streams.values():
        clip = tensor(video)
        for shown in (clip, vae.decode(vae.encode(clip)).cpu()):
            frames = torch.linspace(0, clip.shape[2] - 1, COLUMNS).round().long()
            rows.append(torch.cat(list(shown[0, :, frames].unbind(1)), dim=2))
    pixels = torch.cat(rows, dim=1).permute(1, 2, 0)
    Image.fromarray((255 * pixels).round().byte().numpy()).save(path)
