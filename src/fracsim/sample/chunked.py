"""Arrays of frames as blosc2 files, for fast reading: one compressed chunk a frame, mapped into memory.

Anyone reads them by `blosc2.open(path)[start:stop]`. They have no checksums of their own: meta.json has that of a file.
"""

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from fracsim.records import Array

STORAGE = "blosc2"
"""The entry `storage` in meta.json of a sample whose pictures lie in such files; without it they are videos."""
LEVEL = 1
"""Of zstd. Higher ones and lz4 were measured: no smaller by a tenth, or larger by a fifth at nearly the same speed."""


def file(what: str) -> str:
    """The file of "rgb", "alpha" or a map in the folder of a packed sample."""
    return f"{what}.b2nd" if what in ("rgb", "alpha") else f"maps/{what}.b2nd"


def library() -> ModuleType:
    """The package blosc2; raises ValueError when it is not installed."""
    try:
        import blosc2
    except ImportError:
        raise ValueError("packed samples need blosc2: pip install 'fracsim[formats]'.") from None
    module: ModuleType = blosc2
    return module


def write(path: Path, frames: Array, about: dict[str, Any]) -> None:
    """Write frames (T, ...) of uint8 or uint16, with `about` as metadata of the file.

    Reads them again, since blosc2 does not notice each full disk. Raises OSError when they cannot be written.
    """
    blosc2 = library()
    # Bytes of uint16 are sorted by significance. Colour is better off as it is: sorting takes longer than decoding.
    sort = blosc2.Filter.SHUFFLE if frames.itemsize > 1 else blosc2.Filter.NOFILTER
    # One thread: others would store the blocks of a chunk in the order in which they happen to end.
    settings = blosc2.CParams(codec=blosc2.Codec.ZSTD, clevel=LEVEL, filters=[sort], nthreads=1)
    chunk = (1, *frames.shape[1:])
    try:
        stored = blosc2.asarray(np.ascontiguousarray(frames), chunks=chunk, blocks=chunk, cparams=settings,
                                urlpath=str(path), mode="w")  # fmt: skip
        for name, value in about.items():
            stored.schunk.vlmeta[name] = value
        there = blosc2.open(str(path), mode="r")
        whole = there.schunk.vlmeta.getall() == about and (read(path, 0, len(frames)) == frames).all()
    except (RuntimeError, ValueError) as error:
        raise OSError(f"{path} cannot be written: {error}") from None
    if not whole:
        raise OSError(f"{path} cannot be written: it does not hold what was put there")


def read(path: Path, start: int, stop: int) -> Array:
    """Frames start .. stop - 1, (T, ...); raises ValueError when they cannot be decompressed."""
    blosc2 = library()
    try:
        stored = blosc2.open(str(path), mode="r", mmap_mode="r", dparams=blosc2.DParams(nthreads=1))
        frames: Array = np.empty((stop - start, *stored.shape[1:]), stored.dtype)
        for k, frame in enumerate(frames, start):
            stored.schunk.decompress_chunk(k, dst=frame)
    except (RuntimeError, ValueError, OSError) as error:
        raise ValueError(f"{path} is damaged: {error}. Pack the sample again.") from None
    return frames
