"""Reads a latent cache: a torch data set of clips, opened lazily, a stream at a time; no VAE and no encoder here."""

from collections import OrderedDict
from collections.abc import Collection, Sequence
from copy import copy
from pathlib import Path
from typing import Any, NamedTuple

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor
from torch.utils.data import Dataset

from fracgen import layout
from fracgen.data import index
from fracgen.data.batch import Batch
from fracgen.data.index import FORCE, IMAGE, REFERENCE, TEXT, Row
from fracgen.encoders import pad

OPEN = 64
"""Files that a process keeps open."""


class Place(NamedTuple):
    """Where a clip stands in a training; what the sampler asks the data set for."""

    number: int
    """Its number in the cache."""
    epoch: int = 0
    slot: int = 0
    """Its place in the effective batch."""


class LatentCache(Dataset[Batch]):
    """The clips of a latent cache; T latent frames, H x W latent rows and columns. It can be sent to other processes.

    A clip comes as `Batch` without the batch dimension: latents [16, T, H, W] bfloat16, of the asked streams only.
    """

    def __init__(self, folder: Path | str):
        """Raises ValueError when the folder is no cache, or lacks files."""
        self.folder = Path(folder).expanduser()
        self._index = index.load(self.folder)
        lost = index.lacking(self._index, self.folder)
        if lost:
            named = "; ".join(f"{name} {why}" for name, why in lost.items())
            raise ValueError(f"data.folder={self.folder}: {named}. Repeat the python -m fracgen.encode that made the "
                             "cache: it encodes these clips again.")  # fmt: skip
        self.streams = layout.ordered(self.about["streams"])
        """Streams that are read."""
        self._image = True
        self._where = {kind: self._index.where(kind) for kind in (FORCE, TEXT, IMAGE)}
        self._open: OrderedDict[str, Any] = OrderedDict()

    @property
    def about(self) -> dict[str, Any]:
        """How the cache was made: the entries of cache.json."""
        return self._index.about

    @property
    def rows(self) -> list[Row]:
        """The rows of the index by the clips' numbers: object, split, caption, scales of the maps, and more."""
        return self._index.rows

    def only(self, streams: Sequence[str], image: bool = True) -> "LatentCache":
        """The same clips with only these streams, and the embedding of the picture or None.

        Raises ValueError naming a stream that the cache lacks.
        """
        wanted = layout.ordered(streams)
        missing = [name for name in wanted if name not in self.about["streams"]]
        if missing:
            raise ValueError(f"data.folder={self.folder} lacks {', '.join(missing)}; it has "
                             f"{', '.join(self.about['streams'])}: encode with streams=[{','.join(wanted)}] into "
                             "another folder.")  # fmt: skip
        other = copy(self)
        other.streams, other._image, other._open = wanted, image, OrderedDict()
        return other

    def numbers(self, split: str = "", objects: Collection[str] = ()) -> list[int]:
        """The numbers of the clips of a split, and of these objects; of all where none is given, or the split is `all`.

        Clips whose file was lost are left out; their number waits until they are encoded again.
        """
        there = [k for k, row in enumerate(self.rows) if row["sha256"] and split in ("", "all", row["split"])]
        return [k for k in there if not objects or self.rows[k]["object"] in objects]

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, key: int | Place) -> Batch:
        place = key if isinstance(key, Place) else Place(range(len(self))[key])
        row = self.rows[place.number]
        text = self._read(self._where[TEXT][row["text"]], row["text"])
        image = self._read(self._where[IMAGE][row["image"]], row["image"]) if self._image and row["image"] else None
        return Batch(
            ids=[row["id"]],
            indices=torch.tensor(place.number), epoch=torch.tensor(place.epoch), slot=torch.tensor(place.slot),
            latents={name: self._read(row["shard"], f"{row['id']}.{name}") for name in self.streams},
            force=self._read(self._where[FORCE][row["force"]], row["force"]),
            scalars=torch.tensor(row["scalars"], dtype=torch.float32),
            reference=self._read(row["shard"], f"{row['id']}.{REFERENCE}"),
            text=pad([text])[0],
            image=image,
        )  # fmt: skip

    def _read(self, name: str, key: str) -> Tensor:
        """A tensor of a file; raises ValueError when it cannot be read."""
        try:
            if name not in self._open:
                self._open[name] = safe_open(self.folder / name, framework="pt")
                if len(self._open) > OPEN:
                    self._open.popitem(last=False)
            self._open.move_to_end(name)
            tensor: Tensor = self._open[name].get_tensor(key)
            return tensor
        except (OSError, SafetensorError) as error:
            raise ValueError(f"{self.folder / name} cannot be read ({error}): "
                             f"python -m fracgen.encode output.folder={self.folder} verify=true says what is "
                             "broken.") from None  # fmt: skip

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_open": OrderedDict()}  # a process opens its own

    def __repr__(self) -> str:
        about = self.about
        return (f"{len(self)} clips of {about['frames']} frames, {about['width']} x {about['height']} px, "
                f"{', '.join(self.streams)}, in {self.folder}")  # fmt: skip


def open(folder: Path | str) -> LatentCache:
    """The latent cache in a folder; raises ValueError when it is none, or lacks files."""
    return LatentCache(folder)


def collate(clips: Sequence[Batch]) -> Batch:
    """Clips without the batch dimension as one batch."""

    def stacked(tensors: Sequence[Tensor]) -> Tensor:
        return torch.stack(list(tensors))

    images = [clip.image for clip in clips if clip.image is not None]
    return Batch(
        ids=[name for clip in clips for name in clip.ids],
        latents={name: stacked([clip.latents[name] for clip in clips]) for name in clips[0].latents},
        image=stacked(images) if images else None,
        **{name: stacked([getattr(clip, name) for clip in clips])
           for name in ("indices", "epoch", "slot", "force", "scalars", "reference", "text")},
    )  # fmt: skip
