"""Writes a latent cache: clips are collected and go to disk a file at a time."""

import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import save_file
from torch import Tensor

from fracgen.data import index
from fracgen.data.index import CLIPS, FORCE, IMAGE, REFERENCE, TEXT, Row
from fracsim.sample.identity import digest

SHARED = (FORCE, TEXT, IMAGE)
"""Kinds whose entries several clips share."""
MB = 2**20


class CacheWriter:
    """Adds clips to the cache in a folder, which it begins if there is none; a context that writes what is collected.

    Raises ValueError when the cache there was made otherwise, naming the field, or is being written by another process.
    """

    def __init__(self, folder: Path | str, about: Mapping[str, Any], shard_mb: float = 512, minutes: float = 10):
        """`about` has index.FIELDS. A file is closed at `shard_mb` [MiB], or when it is `minutes` old."""
        self.folder = Path(folder).expanduser()
        self.index = index.begin(self.folder, about)
        self._lock = index.lock(self.folder)
        self.dropped = self._drop_lost()
        """What was wrong with files whose clips are to be encoded again, by file."""
        self.bytes = 0
        """Bytes of the tensors that were added."""
        self._limit, self._seconds = shard_mb * MB, 60 * minutes
        self._numbers = {row["id"]: k for k, row in enumerate(self.index.rows)}
        self._known = {kind: set(self.index.where(kind)) for kind in SHARED}
        self._reset()

    def _reset(self) -> None:
        self._pending: dict[str, dict[str, Tensor]] = {kind: {} for kind in (*SHARED, CLIPS)}
        self._rows: dict[str, Row] = {}
        self._size, self._since = 0, time.monotonic()

    def _drop_lost(self) -> dict[str, str]:
        """Forget files that are missing or cut short, and the clips that need them."""
        lost = index.lacking(self.index, self.folder)
        self.index.files = {name: entry for name, entry in self.index.files.items() if name not in lost}
        where = {kind: self.index.where(kind) for kind in SHARED}
        for row in self.index.rows:
            if row["shard"] not in self.index.files or any(row[k] and row[k] not in where[k] for k in SHARED):
                row["sha256"] = ""  # a clip keeps its number, since random draws are keyed by it
        return lost

    def has(self, clip: str, sha256: str) -> bool:
        """Whether the clip is there, encoded from a sample of this sha256."""
        number = self._numbers.get(clip)
        return number is not None and self.index.rows[number]["sha256"] == sha256

    def shares(self, kind: str, key: str) -> bool:
        """Whether an entry that clips share is there."""
        return key in self._known[kind]

    def share(self, kind: str, key: str, tensor: Tensor) -> None:
        """Add an entry that clips share, of any shape: a latent of blobs, an embedding of a caption or of a picture."""
        if not self.shares(kind, key):
            self._collect(kind, key, tensor)
            self._known[kind].add(key)

    def add(self, row: Row, latents: Mapping[str, Tensor], reference: Tensor) -> None:
        """Add a clip: `row` as in index.SCHEMA but `shard`, latents by stream [16, T, H, W], reference [16, H, W]."""
        for name, latent in {**latents, REFERENCE: reference}.items():
            self._collect(CLIPS, f"{row['id']}.{name}", latent)
        self._rows[row["id"]] = row
        if self._size >= self._limit or time.monotonic() - self._since >= self._seconds:
            self.flush()

    def _collect(self, kind: str, key: str, tensor: Tensor) -> None:
        kept = tensor.detach().to("cpu", torch.bfloat16).contiguous()
        self._pending[kind][key] = kept
        self._size += kept.nbytes
        self.bytes += kept.nbytes

    def flush(self) -> None:
        """Write what is collected; raises OSError where it cannot be written."""
        written = {kind: self._write(kind, tensors) for kind, tensors in self._pending.items() if tensors}
        if not written:
            return
        for name, row in self._rows.items():
            number = self._numbers.setdefault(name, len(self.index.rows))
            self.index.rows[number : number + 1] = [{**row, "shard": written[CLIPS]}]
        index.save(self.index, self.folder)
        self._reset()

    def _write(self, kind: str, tensors: dict[str, Tensor]) -> str:
        """Write a file, list it, and return its name."""
        numbers = [int(name.split("-")[1].split(".")[0]) for name in self.index.files if name.startswith(f"{kind}-")]
        name = f"{kind}-{max(numbers, default=-1) + 1:05}.safetensors"
        with index.replacing(self.folder / name) as new:
            try:
                save_file(tensors, new)
            except SafetensorError as error:
                raise OSError(f"{self.folder / name} cannot be written ({error})") from None
            new.chmod((self.folder / index.ABOUT).stat().st_mode)  # safetensors lets the owner alone read
            entry = {"bytes": new.stat().st_size, "sha256": digest(new), "keys": sorted(tensors)}
        self.index.files[name] = entry
        return name

    def __enter__(self) -> "CacheWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None or not issubclass(kind, OSError):  # Ctrl-C, too, keeps the clips that are done
                self.flush()
        finally:
            self._lock.close()
