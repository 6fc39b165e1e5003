"""Prepared objects on disk: an object is filled once and shared by all runs that use it.

The folder is that of `fracsim.caching`. The key is a hash of all inputs
of the particles, the sources of this package included. The files may be deleted at any time.
"""

import contextlib
import hashlib
import json
import os
import uuid
import warnings
import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from fracsim import registry, sidefiles
from fracsim.caching import folder as folder
from fracsim.records import Particles
from fracsim.scene.vocab import Asset

USED = {
    "builtin": ("kind", "name", "size", "rotate_deg"),
    "mesh": ("kind", "size", "rotate_deg", "interior"),
    "ply": ("kind", "size", "rotate_deg", "interior", "opacity_threshold"),
    "image": ("kind", "size", "rotate_deg", "interior", "depth", "back", "base"),
}
"""The fields of Asset that determine the particles of each kind, together with the contents of asset.path."""
PHOTO = Path(__file__).parents[1] / "photo"
"""The sources that find an object in a photo."""


def key(asset: Asset, spacing: float, seed: int, lattice_deg: float = 0.0) -> str:
    """The sha256, in hex, of all inputs of the particles of an object."""
    inputs = {name: getattr(asset, name) for name in USED[asset.kind]} | {"spacing": float(spacing), "seed": seed}
    inputs["lattice_deg"] = float(lattice_deg)
    digest = hashlib.sha256(json.dumps(inputs, sort_keys=True).encode())
    files = sorted(Path(__file__).parent.rglob("*.py"))
    if asset.kind != "builtin":
        path = Path(asset.path)
        files += [path, *sorted(file for _, file in sidefiles.named(path) if file is not None)]
    if asset.kind == "image":
        from fracsim.photo.cutting import CUTOUTS  # here, because it loads Pillow

        files += [*sorted(PHOTO.rglob("*.py")), registry.source(CUTOUTS, asset.cutout, "asset.cutout")]
        files += [Path(asset.mask)] if asset.mask else []
    for file in files:
        with file.open("rb") as stream:
            content = hashlib.sha256()
            while block := stream.read(1 << 22):
                content.update(block)
        digest.update(content.digest())
    return digest.hexdigest()


def load(name: str) -> Particles | None:
    """The particles stored under a key; None if the file is missing or damaged."""
    try:
        with np.load(folder() / f"{name}.npz", allow_pickle=False) as file:
            values = {f.name: file[f.name] for f in fields(Particles)}
        values["spacing"] = float(values["spacing"])
        values["notes"] = tuple(str(note) for note in values["notes"])
        return Particles(**values)
    except (OSError, ValueError, KeyError, EOFError, AssertionError, zipfile.BadZipFile):
        return None


def store(name: str, particles: Particles) -> None:
    """Store particles under a key. Written to a temporary file and renamed, so that no reader sees half a file."""
    target = folder() / f"{name}.npz"
    temporary = target.with_name(f".{name}.{os.getpid()}.{uuid.uuid4().hex}.npz")
    values = {f.name: getattr(particles, f.name) for f in fields(Particles)}
    values["notes"] = np.array(particles.notes, dtype=np.str_)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        np.savez(temporary, **values)
        temporary.replace(target)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        warnings.warn(f"The prepared object is not kept in {folder()}: {error}. Set FRACSIM_CACHE.", stacklevel=2)
