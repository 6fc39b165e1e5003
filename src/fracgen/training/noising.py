"""What is drawn at random for a batch, each number keyed by (seed, epoch, clip): noise, noise level, what is left out.

Shapes: B clips, C channels, T latent frames, S streams of H x W latent rows and columns.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from fracgen import conditioning, draws, flow
from fracgen.config.conditioning import Conditioning
from fracgen.config.train import Loss
from fracgen.data.batch import Batch
from fracgen.denoiser import Inputs
from fracgen.layout import join, pad_reference

VALIDATION = -1
"""The epoch of draws for validation: they are the same each time."""


class Noised(NamedTuple):
    """A batch between data and noise."""

    x: Tensor
    """The joint latent at the noise level, [B, C, T, S H, W] float32."""
    sigma: Tensor
    """The noise levels, [B] float32."""
    target: Tensor
    """The velocity to predict, noise - x0, [B, C, T, S H, W] float32."""
    inputs: Inputs
    """The conditions, some left out."""


def levels(batch: Batch, cfg: Loss, seed: int, effective_batch: int) -> Tensor:
    """The noise levels of a batch, [B] float32 on the CPU.

    Stratified, the uniform number of the clip in slot k of an effective batch of n lies in [k / n, (k + 1) / n).
    """
    keys = zip(batch.epoch.tolist(), batch.indices.tolist(), batch.slot.tolist(), strict=True)
    u = [((slot + draws.uniform(seed, epoch, index, "level")) / effective_batch if cfg.stratified
          else draws.uniform(seed, epoch, index, "level")) for epoch, index, slot in keys]  # fmt: skip
    return flow.shifted(torch.tensor(u, dtype=torch.float64), cfg.shift).float()


def noise(batch: Batch, seed: int, validation: bool = False) -> Tensor:
    """The noise of a batch, [B, C, T, S H, W] float32, on the device of its latents."""
    first = next(iter(batch.latents.values()))
    _, c, t, h, w = first.shape
    shape = (c, t, len(batch.latents) * h, w)
    epochs = [VALIDATION] * len(batch.ids) if validation else batch.epoch.tolist()
    keys = zip(epochs, batch.indices.tolist(), strict=True)
    return torch.stack([draws.normal(shape, seed, epoch, index, "noise") for epoch, index in keys]).to(first.device)


def kept(batch: Batch, share: float, seed: int, what: str) -> Tensor | None:
    """1 for clips that keep the condition `what`, 0 for the others, [B] on the CPU; None when all keep it."""
    if share == 0:
        return None
    keys = zip(batch.epoch.tolist(), batch.indices.tolist(), strict=True)
    return torch.tensor([float(draws.uniform(seed, epoch, index, what) >= share) for epoch, index in keys])


def masked(condition: Tensor, keep: Tensor | None) -> Tensor:
    """`condition` [B, ...] with zeros for clips that do not keep it; `keep` [B] or None."""
    if keep is None:
        return condition
    return condition * keep.to(condition).reshape(-1, *[1] * (condition.ndim - 1))


def inputs(batch: Batch, cfg: Conditioning, seed: int, train: bool) -> Inputs:
    """The conditions of a batch; in training some captions and pictures are left out, as `cfg` says."""
    text = kept(batch, cfg.drop_text, seed, "text") if train else None
    picture = kept(batch, cfg.drop_reference, seed, "reference") if train else None
    streams = len(batch.latents)
    return Inputs(
        channels=conditioning.channels(batch.force, batch.scalars, streams, cfg.height, cfg.gain),
        reference=pad_reference(masked(batch.reference, picture), streams),
        text=masked(batch.text, text),
        image=None if batch.image is None else masked(batch.image, picture),
    )


def noised(batch: Batch, noise: Tensor, sigma: Tensor, conditions: Inputs) -> Noised:
    """A batch at noise levels `sigma` [B] between its latents and `noise` [B, C, T, S H, W]."""
    x0 = join(batch.latents).float()
    sigma = sigma.to(x0.device)
    return Noised(flow.noisy(x0, noise, sigma), sigma, flow.velocity(x0, noise), conditions)
