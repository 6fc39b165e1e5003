"""What training gets: latents and conditions of B clips, stacked."""

from typing import NamedTuple

from torch import Tensor


class Batch(NamedTuple):
    """B clips. T latent frames, H x W latent rows and columns of one stream; latents have mean near 0, std near 1."""

    ids: list[str]
    """Names of the clips."""
    indices: Tensor
    """Their numbers in the cache, [B] int64; equal whatever is left out of the data set or of the batch."""
    epoch: Tensor
    """The pass over the training clips that they belong to, [B] int64; random draws are keyed by (epoch, index)."""
    slot: Tensor
    """Their places in the effective batch, [B] int64, 0 to effective batch - 1: no two clips of an optimiser step share
    one, whatever the number of processes."""
    latents: dict[str, Tensor]
    """Latents by stream, [B, 16, T, H, W] each, in the order of `fracgen.layout.STREAMS`."""
    force: Tensor
    """Latent of the loading's blobs, [B, 16, T, H, W]."""
    scalars: Tensor
    """Material and fracture in [-1, 1], [B, 6] float32, in the order of `fracgen.conditioning.SCALARS`."""
    reference: Tensor
    """Latent of the object's picture, [B, 16, H, W]."""
    text: Tensor
    """Embedding of the caption, zeros after its end, [B, 512, D]."""
    image: Tensor | None
    """CLIP embedding of the object's picture, [B, 257, 1280]; None for networks without that branch."""
