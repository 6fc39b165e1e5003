"""A clip of the latent cache and what the network makes of it, decoded as metrics and videos ask for it.

What is true here is what the VAE decodes of the cached latents, since training never opens the data set: the error of
the VAE is on both sides, and no metric of the validation counts it.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from torch import Tensor

from fracgen.data import Batch
from fracgen.data.index import Row
from fracgen.evaluation.clip import Clip, Pair
from fracgen.layout import RGB, SPACE
from fracgen.vae import FrozenVae
from fracsim import maps
from fracsim.records import Array

GROUPS = {"object": "object", "class": "class", "axis": "axis_deg"}
"""What clips are grouped by, and its column in the index of the cache."""


def pair(decoder: FrozenVae, batch: Batch, predicted: Mapping[str, Tensor], row: Row, about: Mapping[str, Any]) -> Pair:
    """The clip of a batch of one beside its prediction, latents [1, 16, T, H, W] by stream.

    `row` is its row in the index of a cache that was made as `about` says. The scale of a predicted map is unknown.
    """
    groups = {name: row[column] for name, column in GROUPS.items()}
    scales = {name: float(value) for name, value in (row["scales"] or {}).items() if value is not None}
    return Pair(
        clip(decoder, batch.ids[0], predicted, about), clip(decoder, batch.ids[0], batch.latents, about, scales), groups
    )


def clip(
    decoder: FrozenVae,
    name: str,
    latents: Mapping[str, Tensor],
    about: Mapping[str, Any],
    scales: Mapping[str, float] | None = None,
) -> Clip:
    """Latents [1, 16, T, H, W] by stream as a clip, each decoded once it is asked for."""
    loads: dict[str, Callable[[], Array]] = {
        stream: partial(_bytes if stream == RGB else _map, decoder, z, stream) for stream, z in latents.items()
    }
    height, width = (SPACE * n for n in latents[RGB].shape[-2:])
    return Clip(name, about["frames"], height, width, about["fps"], loads, scales or {})


def picture(clip: Clip, stream: str) -> Array:
    """A stream as people see it, (T, H, W, 3) uint8."""
    if stream == RGB:
        return np.asarray(clip.rgb)
    shown = np.rint(255 * clip.map(stream)).astype(np.uint8)
    return np.asarray(np.broadcast_to(shown, (*shown.shape[:3], 3)))


def pixels(decoder: FrozenVae, latent: Tensor) -> Array:
    """The frames (T, H, W, 3), bytes, of a latent [1, 16, t, h, w]."""
    return np.asarray(np.rint(255 * _decoded(decoder, latent)).astype(np.uint8))


def _decoded(decoder: FrozenVae, latent: Tensor) -> Array:
    """The frames (T, H, W, 3) in [0, 1] of a latent [1, 16, t, h, w]."""
    return np.asarray(decoder.decode(latent.float())[0].permute(1, 2, 3, 0).cpu().numpy())


def _bytes(decoder: FrozenVae, latent: Tensor, stream: str) -> Array:
    """Colour, (T, H, W, 3) uint8, of a latent [1, 16, t, h, w]."""
    return pixels(decoder, latent)


def _map(decoder: FrozenVae, latent: Tensor, stream: str) -> Array:
    """A map in [0, 1] of a latent [1, 16, t, h, w]: (T, H, W, 3) for a vector, (T, H, W, 1), its grey, for a scalar."""
    video = _decoded(decoder, latent)
    return video if maps.load(stream).CHANNELS == 2 else np.asarray(video.mean(axis=-1, keepdims=True))
