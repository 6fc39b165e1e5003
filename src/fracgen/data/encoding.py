"""From a data set of clips to a latent cache; nothing is computed that is there already, or that is not asked for."""

import shutil
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

import fracsim.dataset
from fracgen import conditioning, encoders, layout
from fracgen.config.encode import EncodeConfig
from fracgen.data import pictures
from fracgen.data.choose import choose
from fracgen.data.index import FORCE, IMAGE, TEXT, Row
from fracgen.data.summary import Progress, Summary
from fracgen.data.writer import CacheWriter
from fracsim.dataset import Clip
from fracsim.dataset.captions import prompt
from fracsim.records import Array

CAPTIONS = 16
"""Captions that are encoded at once."""
GB = 2**30


class Vae(Protocol):
    """What `fracgen.vae.FrozenVae` is to a cache."""

    identity: str

    def encode(self, video: Tensor) -> Tensor:
        """Latents [B, 16, T, H, W] of videos [B, 3, F, h, w] in [0, 1]."""
        ...


class Ready(NamedTuple):
    """A clip, decoded."""

    row: Row
    paths: Array
    """Positions of the grips [px], (F, 2, 2)."""
    videos: list[pictures.Video]


def encode(cfg: EncodeConfig, vae: Vae, device: torch.device) -> Summary:
    """Encode the clips of a data set that are not in the cache yet; `vae` is on `device`, where the encoders run too.

    Raises ValueError when the data set or the cache does not fit what is asked for, OSError where it cannot be written.
    """
    chosen = choose(fracsim.dataset.open(cfg.data, cfg.suspect), cfg)
    about = describe(cfg, vae.identity, chosen.fps)
    with CacheWriter(cfg.output.folder, about, cfg.output.shard_mb, cfg.output.minutes) as writer:
        todo = [clip for clip in chosen.clips if not writer.has(clip.row["id"], clip.row["sha256"])]
        summary = Summary(len(chosen.clips), len(todo), left_out=chosen.left_out)
        if todo:
            _check_room(len(todo), cfg)
            _captions(todo, cfg, writer, device)
            image = encoders.image(cfg.encoders, device)
            _clips(todo, cfg, writer, vae, image, summary)
    return summary


def describe(cfg: EncodeConfig, vae: str, fps: float) -> dict[str, Any]:
    """What the latents depend on beside the clips, the entries of cache.json; `vae` is the identity of the VAE."""
    return {
        "vae": vae, "vae_dtype": cfg.vae.dtype, "width": cfg.width, "height": cfg.height, "frames": cfg.frames,
        "frame_select": cfg.frame_select, "fps": fps, "streams": list(cfg.streams),
        "text": encoders.text_identity(cfg.encoders, cfg.text_dim), "text_dim": cfg.text_dim,
        "image": encoders.image_identity(cfg.encoders), "dtype": "bfloat16",
        "normalisation": {"version": pictures.NORMALISATION, "percentile": cfg.percentile},
    }  # fmt: skip


def clip_bytes(cfg: EncodeConfig) -> int:
    """Bytes of the latents of a clip without its force, which others may share."""
    columns, rows = layout.latent_size(cfg.width, cfg.height)
    return 2 * layout.CHANNELS * columns * rows * (len(cfg.streams) * layout.latent_frames(cfg.frames) + 1)


def _check_room(clips: int, cfg: EncodeConfig) -> None:
    """Raise ValueError when the latents cannot fit on the disk."""
    free, needed = shutil.disk_usage(cfg.output.folder).free, clips * clip_bytes(cfg)
    if needed > free:
        raise ValueError(f"output.folder={cfg.output.folder} has {free / GB:.3g} GB free, but the latents of {clips} "
                         f"clips take {needed / GB:.3g} GB: choose another folder, fewer streams or frames, or a "
                         "smaller width and height.")  # fmt: skip


def _captions(clips: Sequence[Clip], cfg: EncodeConfig, writer: CacheWriter, device: torch.device) -> None:
    """Encode each caption that is not there once; the encoder leaves the memory again before the VAE works."""
    wanted = {pictures.key(prompt(clip.row).encode()): prompt(clip.row) for clip in clips}
    missing = [(key, caption) for key, caption in wanted.items() if not writer.shares(TEXT, key)]
    if not missing:
        return
    encoder = encoders.text(cfg.encoders, cfg.text_dim, device)
    for k in range(0, len(missing), CAPTIONS):
        keys, captions = zip(*missing[k : k + CAPTIONS], strict=True)
        for key, embedding in zip(keys, encoder.encode(list(captions)), strict=True):
            writer.share(TEXT, key, embedding)
    writer.flush()


def _clips(
    clips: Sequence[Clip], cfg: EncodeConfig, writer: CacheWriter, vae: Vae, image: encoders.ImageEncoder | None,
    summary: Summary,
) -> None:  # fmt: skip
    """Encode clips, and count them; those that cannot be read are left out, or raise with `strict`."""
    with Progress(summary) as progress:
        for clip, ready in zip(clips, _ahead(clips, cfg), strict=True):
            if isinstance(ready, Ready):
                _add(ready, writer, vae, image, summary, cfg)
            elif cfg.strict:
                raise ready
            else:
                summary.left_out.setdefault(str(ready), []).append(clip.row["id"])
            progress.step()


def _ahead(clips: Sequence[Clip], cfg: EncodeConfig) -> Iterator[Ready | ValueError]:
    """Each clip decoded, or why it cannot be; a thread reads the next one while the caller works on this one."""

    def prepare(clip: Clip) -> Ready | ValueError:
        try:
            return Ready(*_conditions(clip, cfg), [pictures.video(clip, name, cfg) for name in cfg.streams])
        except ValueError as error:
            return error

    with ThreadPoolExecutor(1) as pool:
        waiting: Future[Ready | ValueError] = pool.submit(prepare, clips[0])
        for following in clips[1:]:
            ready = waiting.result()
            waiting = pool.submit(prepare, following)
            yield ready
        yield waiting.result()


def _conditions(clip: Clip, cfg: EncodeConfig) -> tuple[Row, Array]:
    """The row of a clip without what its pictures tell, and the positions of its grips."""
    condition = conditioning.of_scene(clip.sample.scene)
    paths = pictures.grips(clip, cfg)
    copied = {name: clip.row[name] for name in ("id", "split", "object", "class", "sha256")}
    caption = prompt(clip.row)  # the table's own caption tells the outcome, which nobody knows before
    return {
        **copied, "caption": caption,
        "scalars": conditioning.scalars(condition, cfg.ranges).tolist(), "E": condition.E, "nu": condition.nu,
        "onset": condition.onset, "crit": condition.crit, "axis_deg": clip.row["loading_axis_deg"],
        "force": pictures.grips_key(paths, cfg), "text": pictures.key(caption.encode()),
    }, paths  # fmt: skip


def _add(
    ready: Ready, writer: CacheWriter, vae: Vae, image: encoders.ImageEncoder | None, summary: Summary,
    cfg: EncodeConfig,
) -> None:  # fmt: skip
    """Encode a clip, each stream apart, and what it shares with others if that is not there."""
    row, videos = ready.row, ready.videos
    latents = {video.stream: _latent(vae, video.tensor(), cfg) for video in videos}
    if not writer.shares(FORCE, row["force"]):
        blobs = torch.from_numpy(conditioning.blobs(ready.paths, cfg.width, cfg.height))
        writer.share(FORCE, row["force"], _latent(vae, blobs.permute(3, 0, 1, 2)[None], cfg))
    row["scales"] = {video.stream: video.scale for video in videos if video.scale is not None}
    row["image"] = _picture(videos[0].frames[0], image, writer) if image else None
    # The VAE is causal and takes the first frame alone, so that its latent is that of the picture alone.
    writer.add(row, latents, latents[layout.RGB][:, 0])
    summary.count(latents)
    summary.done += 1
    summary.bytes = writer.bytes


def _latent(vae: Vae, video: Tensor, cfg: EncodeConfig) -> Tensor:
    """The latent [16, T, H, W] of a video [1, 3, F, h, w]; raises ValueError when it is not finite."""
    latent = vae.encode(video)[0]
    if not torch.isfinite(latent).all():
        raise ValueError(f"vae.dtype={cfg.vae.dtype}: the VAE gives numbers that are not finite: set "
                         "vae.dtype=float32, or check its weights.")  # fmt: skip
    return latent


def _picture(first: Array, image: encoders.ImageEncoder, writer: CacheWriter) -> str:
    """The key of the embedding of a first frame [h, w, 3], which is computed if it is not there."""
    picture = np.ascontiguousarray(np.round(first).astype(np.uint8))
    name = pictures.key(picture.tobytes(), str(picture.shape).encode())
    if not writer.shares(IMAGE, name):
        writer.share(IMAGE, name, image.encode(torch.from_numpy(picture)[None])[0])
    return name
