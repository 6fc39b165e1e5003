"""Weights on disk: read, compared name by name with the network that is to have them, and identified by a hash."""

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import torch
from torch import Tensor, nn

DIGITS = 12
"""Hex digits of an identity."""
_BLOCK, _BLOCKS = 1 << 20, 64
"""Bytes of a block, and blocks, that are hashed of a large file."""


def read(path: Path) -> dict[str, Tensor]:
    """Tensors by name of a .safetensors or a torch file, on the CPU; nothing in a torch file is run.

    Raises ValueError for a file that is neither.
    """
    try:
        if path.suffix == ".safetensors":
            from safetensors.torch import load_file

            return dict(load_file(path))
        mapped = is_zipfile(path)  # files of before 2020 are none, and cannot be mapped
        content = torch.load(path, map_location="cpu", weights_only=True, mmap=mapped)
        content = content.get("state_dict", content)
        return {str(name): value for name, value in content.items() if isinstance(value, Tensor)}
    except Exception as error:
        reason = " ".join(str(error).split())[:200]
        raise ValueError(
            f"{path} cannot be read as weights ({reason}): give a whole .safetensors or .pth file; a download that "
            "broke off, or a pointer of Git LFS, is none."
        ) from None


def fit(network: nn.Module, tensors: Mapping[str, Tensor], source: Path | str) -> None:
    """Give `network`, on whatever device, these tensors; raises ValueError naming the first that do not fit."""
    wanted = network.state_dict()
    missing = [name for name in wanted if name not in tensors]
    extra = [name for name in tensors if name not in wanted]
    shapes = [
        f"{name} {list(tensors[name].shape)} instead of {list(value.shape)}"
        for name, value in wanted.items()
        if name in tensors and tensors[name].shape != value.shape
    ]
    faults = [_some("lacks", missing), _some("has beside them", extra), _some("has of another shape", shapes)]
    if any(faults):
        raise ValueError(
            f"{source} does not hold the weights of this network: it {'; it '.join(f for f in faults if f)}. Choose "
            "the sizes that it was made with, or another file."
        )
    network.load_state_dict(dict(tensors), strict=True, assign=True)


def _some(what: str, names: list[str]) -> str:
    """The first names of a fault; "" when there is none."""
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"{what} {', '.join(names[:3])}{more}" if names else ""


def digest(tensors: Mapping[str, Tensor], about: Any = None) -> str:
    """12 hex digits over names, shapes, types and bytes of all tensors, in any order, and over `about`."""
    out = hashlib.blake2b(repr(about).encode())
    for name in sorted(tensors):
        flat = tensors[name].detach().cpu().contiguous()
        out.update(repr((name, tuple(flat.shape), str(flat.dtype))).encode())
        out.update(flat.reshape(-1).view(torch.uint8).numpy().data)
    return out.hexdigest()[:DIGITS]


def digest_files(paths: Iterable[Path], about: Any = None) -> str:
    """12 hex digits over the content of files, in the order of their names, and over `about`.

    Of a file beyond 64 MiB, its size and 64 blocks of 1 MiB, spread evenly: other weights differ in every block, and
    11 GB are identified in a fraction of a second. This does not find single broken bytes.
    """
    out = hashlib.blake2b(repr(about).encode())
    for path in sorted(paths):
        size = path.stat().st_size
        out.update(repr((path.name, size)).encode())
        starts = list(range(0, size, _BLOCK))
        if len(starts) > _BLOCKS:  # spread from the first to the last byte
            starts = [k * (size - _BLOCK) // (_BLOCKS - 1) for k in range(_BLOCKS)]
        with path.open("rb") as file:
            for start in starts:
                file.seek(start)
                out.update(file.read(_BLOCK))
    return out.hexdigest()[:DIGITS]


def download(name: str, patterns: list[str], field: str) -> Path:
    """The local copy of the files of a repository on the hub that match; raises ValueError when it cannot be had."""
    from huggingface_hub import snapshot_download

    try:
        return Path(snapshot_download(name, allow_patterns=patterns))
    except Exception as error:
        reason = " ".join(str(error).split())[:200]
        raise ValueError(
            f"{field}={name} cannot be downloaded from the hub ({reason}): check the name and the connection, or set "
            f"{field} to a local folder."
        ) from None
