"""Features of clips, computed once: metrics share them in memory, and those of true clips lie in the cache folder.

A vector belongs to a network and to the bytes of the frames, whatever the clip is called. Files of the cache may be
deleted at any time; they are not read by another version of this package's networks.
"""

import contextlib
import hashlib
import json
import os
import uuid
import warnings
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np

from fracgen.evaluation.clip import Clip, LackingError
from fracgen.layout import RGB
from fracsim import caching, registry
from fracsim.records import Array

PACKAGE = "fracgen.features"

_readers: "WeakValueDictionary[tuple[str, str, str], Reader]" = WeakValueDictionary()
"""Networks in use, by name, weights and device."""
_vectors: "WeakKeyDictionary[Clip, dict[tuple[str, bytes], Array]]" = WeakKeyDictionary()
"""Features of clips in use, by network and frames."""


class Reader:
    """Features of clips by one network, each computed once."""

    def __init__(self, network: Callable[[Array], Array], about: Mapping[str, Any], code: str) -> None:
        self.network, self.about = network, dict(about)
        self.least: int = getattr(network, "least", 1)
        """Fewest frames that the network takes."""
        self.identity = json.dumps({**self.about, "code": code}, sort_keys=True, default=str)

    def __deepcopy__(self, memo: dict[int, Any]) -> "Reader":
        """The same: metrics are copied by torchmetrics and Lightning, and a network that never changes need not be."""
        return self

    def vector(self, clip: Clip, chosen: Array, stored: bool = False) -> Array:
        """Features (D,) float64 of the chosen frames (K,) of a clip; `stored` keeps them on disk too.

        Raises LackingError for a clip without colour or with too few frames.
        """
        if len(chosen) < self.least:
            raise LackingError(f"{clip.name} has {len(chosen)} frames; {self.about.get('network')} needs {self.least}")
        known = _vectors.setdefault(clip, {})
        key = (self.identity, chosen.astype(np.int64).tobytes())
        if key not in known:
            video = np.ascontiguousarray(clip.get(RGB)[chosen])
            known[key] = self._stored(video) if stored and self.about.get("sha256") else self.network(video)
        return known[key]

    def _stored(self, video: Array) -> Array:
        """Features (D,) of a video (T, H, W, 3), from the cache folder if they are there."""
        digest = hashlib.sha256(f"{self.identity} {video.shape} {video.dtype}".encode())
        digest.update(video.reshape(-1).data)
        path = caching.folder() / "features" / f"{digest.hexdigest()}.npy"
        found = _load(path)
        if found is None:
            found = self.network(video)
            _store(path, found)
        return found


def reader(name: str, weights: str, device: str, section: str) -> Reader:
    """Features by the network `name`, which is loaded once for all metrics in use that name it.

    `section`.extractor, .weights and .device are the fields of the configuration that errors name. Raises
    MissingWeightsError without weights, and ValueError for what cannot be used.
    """
    found = _readers.get((name, weights, device))
    if found is None:
        module = registry.load(PACKAGE, name, f"{section}.extractor")
        network = module.build(_settings(module, name, section, {"weights": weights, "device": device}))
        about = {"extractor": registry.label(name), **network.about()}
        found = _readers[name, weights, device] = Reader(network, about, _code(module.__file__ or ""))
    return found


def _settings(module: ModuleType, name: str, section: str, given: Mapping[str, str]) -> Any:
    """The settings of a network, which take of the fields given those that they have."""
    has = {f.name for f in fields(module.Settings)}
    if given["weights"] and "weights" not in has:
        raise ValueError(f"{section}.weights={given['weights']}: {name} has no weights; leave it empty.")
    return module.Settings(**{key: value for key, value in {**given, "section": section}.items() if key in has})


@cache
def _code(file: str) -> str:
    """A hash of the sources on which features rest."""
    digest = hashlib.sha256()
    for path in sorted({*Path(__file__).parent.glob("*.py"), Path(file)}):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _load(path: Path) -> Array | None:
    """The features (D,) in a file; None if it is missing or damaged."""
    try:
        found = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    return found if found.ndim == 1 and found.dtype == np.float64 else None


def _store(path: Path, features: Array) -> None:
    """Write features (D,); written beside and renamed, so that no reader sees half a file."""
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.{uuid.uuid4().hex}.npy")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(temporary, features)
        temporary.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        warnings.warn(f"Features are not kept in {path.parent}: {error}. Set FRACSIM_CACHE.", stacklevel=2)
