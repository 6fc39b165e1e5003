"""A latent cache of random numbers, for tests and for measuring, without data set, VAE and encoders."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from fracgen import layout
from fracgen.conditioning import SCALARS
from fracgen.data.index import FORCE, IMAGE, TEXT
from fracgen.data.writer import CacheWriter
from fracgen.draws import generator

OBJECTS = {"croissant": "train", "duck": "train", "bread": "test", "star": "test"}
"""Objects of the clips in turn, and their splits."""


def write(
    folder: Path | str, clips: int = 8, streams: Sequence[str] = layout.STREAMS, frames: int = 9, size: int = 32,
    text_dim: int = 64, image_dim: int = 0, seed: int = 0, about: Mapping[str, Any] | None = None,
) -> Path:  # fmt: skip
    """Write a cache of `clips` clips of normal latents, `size` x `size` pixels, and return its folder.

    Half of the clips are of the split train. Two clips share a force, all of an object a caption of three words.
    `about` has entries of cache.json that differ, as the identity of a VAE.
    """
    draw = generator(seed, "synthetic")
    picture = (layout.CHANNELS, size // layout.SPACE, size // layout.SPACE)
    video = (layout.CHANNELS, layout.latent_frames(frames), *picture[1:])
    wanted = layout.ordered(streams)
    made = {"vae": "synthetic", "vae_dtype": "float32", "width": size, "height": size, "frames": frames,
             "frame_select": "head", "fps": 100.0, "streams": list(wanted), "text": "synthetic", "text_dim": text_dim,
             "image": "synthetic" if image_dim else "", "dtype": "bfloat16",
             "normalisation": {"version": 1, "percentile": 99.5}, **(about or {})}  # fmt: skip
    with CacheWriter(folder, made) as writer:
        for k in range(clips):
            name = list(OBJECTS)[k % len(OBJECTS)]
            force, image = f"force{k // 2}", f"image-{name}" if image_dim else None
            writer.share(FORCE, force, torch.randn(video, generator=draw))
            writer.share(TEXT, name, torch.randn((3, text_dim), generator=draw))
            if image:
                writer.share(IMAGE, image, torch.randn((257, image_dim), generator=draw))
            scalars = (2 * torch.rand(len(SCALARS), generator=draw) - 1).tolist()
            row = {"id": f"clip{k:04}", "split": OBJECTS[name], "object": name, "class": "low_stretch",
                   "caption": f"A {name} breaks.", "scalars": scalars,
                   "scales": dict.fromkeys(layout.MAPS, 1.0), "E": 6e3, "nu": 0.25, "onset": 1.5, "crit": 2.3,
                   "axis_deg": 0.0, "sha256": f"{k}", "force": force, "text": name, "image": image}  # fmt: skip
            latents = {stream: torch.randn(video, generator=draw) for stream in wanted}
            writer.add(row, latents, latents[layout.RGB][:, 0])
    return writer.folder
