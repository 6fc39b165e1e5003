"""Files .spz (Niantic), versions 1 to 4: attribute by attribute, quantised, compressed by gzip or, from 4 on, zstd.

Decoded as the format's public description says: positions are fixed point (version 1: half floats), scales are
logarithms in steps of 1/16 from -10 on, colours are 0.5 + 0.15 f_dc. y is up.
"""

import struct
import zlib
from pathlib import Path

import numpy as np

from fracsim.asset.cloud import Gaussians, Rows, gaussians
from fracsim.records import Array

MAGIC = b"NGSP"
GZIP = b"\x1f\x8b"
VERSIONS = (1, 2, 3, 4)
COEFFICIENTS = {0: 0, 1: 3, 2: 8, 3: 15, 4: 24}
"""Coefficients a colour beside the constant one, by SH degree."""
KEPT = 15
"""Those of degree 3 and below are drawn."""


def is_one(head: bytes) -> bool:
    """Whether a file that begins with `head` is of this kind."""
    return head.startswith(MAGIC) or (head.startswith(GZIP) and _inflated(head, 4) == MAGIC)


def count(path: str | Path) -> int:
    """The number of Gaussians, from the header."""
    with Path(path).open("rb") as stream:
        head = stream.read(1 << 12)
    return int(_header(path, head if head.startswith(MAGIC) else _inflated(head, 16))[1])


def read(path: str | Path) -> Gaussians:
    """The Gaussians of the file; raises ValueError, with asset.path, if it is cut off or of a later version."""
    content = Path(path).read_bytes()
    body = _streams(path, content) if content.startswith(MAGIC) else _unzipped(path, content)
    version, n, degree, bits = _header(path, body if body.startswith(MAGIC) else content)
    body = body[16:] if body.startswith(MAGIC) else body
    sizes = [n * k for k in (6 if version == 1 else 9, 1, 3, 3, 3 if version < 3 else 4, 3 * COEFFICIENTS[degree])]
    if len(body) < sum(sizes) or not n:
        raise ValueError(f"asset.path={path} is a cut off or empty .spz file: give a whole one.")
    parts = np.split(np.frombuffer(body[: sum(sizes)], np.uint8), np.cumsum(sizes)[:-1])
    place, alpha, colour, scale, turn, rest = (p.reshape(n, -1) for p in parts)
    sh = ((colour / 255.0 - 0.5) / 0.15)[:, None, :]
    if degree:
        sh = np.concatenate([sh, ((rest - 128.0) / 128.0).reshape(n, -1, 3)[:, :KEPT]], axis=1)
    quaternion = _first_three(turn) if version < 3 else _smallest_three(turn)
    rows = Rows(_positions(place, version, bits), np.exp(scale / 16.0 - 10.0), quaternion, alpha[:, 0] / 255.0, sh)
    note = "Colours of the file have SH degree 4; degrees up to 3 are drawn." if degree == 4 else ""
    return gaussians(path, rows, (note,) if note else ())


def _inflated(content: bytes, size: int) -> bytes:
    """The first `size` bytes of what is compressed by gzip; fewer if it is damaged."""
    try:
        return zlib.decompressobj(31).decompress(content, size)
    except zlib.error:
        return b""


def _unzipped(path: str | Path, content: bytes) -> bytes:
    """The whole content of versions 1 to 3."""
    try:
        return zlib.decompressobj(31).decompress(content)
    except zlib.error as error:
        raise ValueError(f"asset.path={path} is a damaged .spz file ({error}): give a whole one.") from error


def _header(path: str | Path, head: bytes) -> tuple[int, int, int, int]:
    """Version, number of Gaussians, SH degree and fractional bits of positions."""
    if len(head) < 16:
        raise ValueError(f"asset.path={path} is a damaged .spz file: give a whole one.")
    version, n, degree, bits = struct.unpack("<4xIIBB2x", head[:16])
    if version not in VERSIONS or degree not in COEFFICIENTS:
        raise ValueError(
            f"asset.path={path} is an .spz file of version {version} and SH degree {degree}, versions "
            f"{VERSIONS[0]} to {VERSIONS[-1]} and degrees 0 to 4 are read: convert it to .ply, as by "
            "`npx @playcanvas/splat-transform in.spz out.ply`."
        )
    return version, n, degree, bits


def _streams(path: str | Path, content: bytes) -> bytes:
    """The attributes of version 4, one after the other: zstd streams, their sizes in a table."""
    import pyarrow

    _header(path, content)
    try:
        streams, table = content[15], struct.unpack_from("<I", content, 16)[0]
        sizes = [struct.unpack_from("<QQ", content, table + 16 * k) for k in range(streams)]
        at, out = table + 16 * streams, b""
        for packed, size in sizes:
            out += pyarrow.Codec("zstd").decompress(content[at : at + packed], size, asbytes=True)
            at += packed
    except (struct.error, OSError, ValueError, pyarrow.ArrowException) as error:
        raise ValueError(f"asset.path={path} is a damaged .spz file ({error}): give a whole one.") from error
    return out


def _positions(place: Array, version: int, bits: int) -> Array:
    """Centres (N, 3) of bytes (N, 6) or (N, 9): half floats, or signed integers of 24 bits over 2^bits."""
    if version == 1:
        return np.ascontiguousarray(place).view("<f2").astype(np.float64)
    b = place.reshape(len(place), 3, 3).astype(np.int32)
    value = b[..., 0] | b[..., 1] << 8 | b[..., 2] << 16
    out: Array = np.where(value >= 1 << 23, value - (1 << 24), value) / float(1 << bits)
    return out


def _first_three(turn: Array) -> Array:
    """Quaternions w x y z (N, 4) of the bytes of x y z (N, 3); w is not negative."""
    xyz = turn / 127.5 - 1.0
    w = np.sqrt(np.maximum(0.0, 1.0 - (xyz**2).sum(axis=1)))
    return np.concatenate([w[:, None], xyz], axis=1)


def _smallest_three(turn: Array) -> Array:
    """Quaternions w x y z (N, 4) of four bytes (N, 4): which of x y z w is largest, then the others in ten bits each,
    the last one lowest, as a sign and a magnitude.
    """
    code = np.ascontiguousarray(turn).view("<u4")[:, 0]
    largest, xyzw = (code >> 30).astype(int), np.zeros((len(code), 4))
    for k in (3, 2, 1, 0):
        mine = largest != k
        magnitude = (code & 511) * (np.sqrt(0.5) / 511.0)
        xyzw[mine, k] = np.where(code >> 9 & 1, -magnitude, magnitude)[mine]
        code = np.where(mine, code >> 10, code)
    rows = np.arange(len(code))
    xyzw[rows, largest] = np.sqrt(np.maximum(0.0, 1.0 - (xyzw**2).sum(axis=1)))
    return xyzw[:, [3, 0, 1, 2]]
