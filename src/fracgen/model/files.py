"""Files of a checkpoint of the transformer: where they lie, and what they hold."""

import hashlib
import json
from functools import lru_cache
from pathlib import Path

from fracgen.config.model import Model

STEM = "diffusion_pytorch_model"
LAYOUTS = (
    f"{STEM}.safetensors, or {STEM}.safetensors.index.json with its shards, and config.json, in this folder or its "
    "folder transformer"
)
CHUNK = 1 << 24
"""Bytes that are read at once."""


def folder(cfg: Model) -> Path:
    """The local folder with the weights of `cfg`, fetched from the hub if `cfg.hub`; raises ValueError."""
    root = _from_hub(cfg.path) if cfg.hub else Path(cfg.path).expanduser()
    if not root.is_dir():
        raise ValueError(f"model.path={cfg.path} is no folder: give the folder of the weights, set model.hub=true if "
                         "it is a name on the hub, or model.path='' for random weights.")  # fmt: skip
    inner = root / "transformer"
    return inner if inner.is_dir() else root


def _from_hub(name: str) -> Path:
    """The local copy of the transformer of a repository on the hub; raises ValueError with the reason."""
    from huggingface_hub import snapshot_download

    patterns = [f"{prefix}{file}" for prefix in ("", "transformer/") for file in (f"{STEM}*", "config.json")]
    try:
        return Path(snapshot_download(name, allow_patterns=patterns))
    except Exception as error:  # no network, no such name, no right to it, no space: all are the user's to mend
        raise ValueError(f"model.path={name} cannot be fetched from the hub ({type(error).__name__}: {error}): check "
                         "the name, the network and your token, or fetch it elsewhere and set model.path to its folder "
                         "and model.hub=false.") from None  # fmt: skip


def weight_files(place: Path) -> list[Path]:
    """The safetensors files of a checkpoint in `place`; raises ValueError if there are none or some are missing."""
    whole, index = place / f"{STEM}.safetensors", place / f"{STEM}.safetensors.index.json"
    if whole.exists():
        return [whole]
    if not index.exists():
        found = ", ".join(sorted(file.name for file in place.iterdir())[:8]) or "nothing"
        raise ValueError(f"model.path: {place} holds {found}, but no weights: needed is {LAYOUTS}.")
    try:
        names = sorted(set(json.loads(index.read_text(encoding="utf-8"))["weight_map"].values()))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"model.path: {index} cannot be read ({error!r}): fetch it again.") from None
    missing = [name for name in names if not (place / name).exists()]
    if missing:
        raise ValueError(f"model.path: {len(missing)} of {len(names)} shards are missing in {place}, as {missing[0]}: "
                         "fetch them again.")  # fmt: skip
    return [place / name for name in names]


def digest(files: list[Path]) -> str:
    """12 hex digits over the content of files, in order; a file is read once a process, unless it changes."""
    state = hashlib.blake2b(digest_size=6)
    for file in files:
        facts = file.stat()
        state.update(_content(file, facts.st_mtime_ns, facts.st_size))
    return state.hexdigest()


@lru_cache(maxsize=64)
def _content(file: Path, changed: int, size: int) -> bytes:
    """Hash of the content of a file that was last `changed` then."""
    state = hashlib.blake2b()
    with file.open("rb") as stream:
        while chunk := stream.read(CHUNK):
            state.update(chunk)
    return state.digest()
