"""Compressed .ply files (SuperSplat, splat-transform): 16 bytes a Gaussian, in chunks of 256 with common ranges.

Positions and logarithms of scales take 11, 10 and 11 bits between the least and greatest value of the chunk,
rotations the three smallest components in 10 bits each after 2 bits for the largest, colours and opacity a byte each.
"""

from pathlib import Path
from typing import Any

import numpy as np

from fracsim.asset.cloud import Gaussians, Rows, gaussians
from fracsim.asset.gaussians import SH_C0
from fracsim.records import Array

CHUNK = 256
PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")


def read(path: str | Path, elements: dict[str, Any]) -> Gaussians:
    """The Gaussians of the elements of a PLY file by name; raises ValueError, with asset.path, if some are missing."""
    vertex, chunk = elements["vertex"], elements.get("chunk")
    n = len(vertex[PACKED[0]])
    names = {p.name for p in vertex.properties}
    if chunk is None or len(chunk["min_x"]) * CHUNK < n or not names.issuperset(PACKED):
        raise ValueError(f"asset.path={path} is a compressed .ply without all of its chunks: export it again.")
    of = np.arange(n) // CHUNK
    ranges = {p.name: np.asarray(chunk[p.name], np.float64)[of] for p in chunk.properties}

    def between(fraction: Array, *fields: str) -> Array:
        """Fractions (N, 3) of the ranges of the chunks, (N, 3)."""
        lo, hi = (np.stack([ranges[f"{end}_{f}"] for f in fields], axis=1) for end in ("min", "max"))
        return np.asarray(lo + fraction * (hi - lo))

    colour = _bits(vertex["packed_color"], 8, 8, 8, 8)
    rgb = between(colour[:, :3], "r", "g", "b") if "min_r" in ranges else colour[:, :3]
    scales = between(_bits(vertex["packed_scale"], 11, 10, 11), "scale_x", "scale_y", "scale_z")
    rows = Rows(
        means=between(_bits(vertex["packed_position"], 11, 10, 11), "x", "y", "z"),
        deviations=np.exp(scales),
        quaternion=_quaternion(np.asarray(vertex["packed_rotation"], np.uint32)),
        opacity=colour[:, 3],
        sh=np.concatenate([((rgb - 0.5) / SH_C0)[:, None, :], _rest(elements.get("sh"), n)], axis=1),
    )
    return gaussians(path, rows)


def _bits(code: Array, *widths: int) -> Array:
    """Fractions in [0, 1], (N, len(widths)), of codes (N,): fields of these widths, the first one highest."""
    code, out = np.asarray(code, np.uint32), []
    for width in reversed(widths):
        out.append((code & (1 << width) - 1) / ((1 << width) - 1))
        code = code >> width
    return np.stack(out[::-1], axis=1)


def _quaternion(code: Array) -> Array:
    """Quaternions w x y z (N, 4) of codes (N,)."""
    three = (_bits(code, 2, 10, 10, 10)[:, 1:] - 0.5) * np.sqrt(2)
    largest = (code >> 30).astype(int)
    whole = np.sqrt(np.maximum(0.0, 1.0 - (three**2).sum(axis=1)))
    out = np.empty((len(code), 4))
    for k in range(4):
        out[largest == k] = np.insert(three, k, whole, axis=1)[largest == k]
    return out


def _rest(element: Any, n: int) -> Array:
    """Higher coefficients (N, K - 1, 3) of the element sh, in bytes, channel by channel; none without it."""
    if element is None:
        return np.zeros((n, 0, 3))
    codes = np.stack([np.asarray(element[p.name], np.float64) for p in element.properties], axis=1)
    fraction = np.where(codes == 0, 0.0, np.where(codes == 255, 1.0, (codes + 0.5) / 256))
    out: Array = (8 * (fraction - 0.5)).reshape(n, 3, -1).transpose(0, 2, 1)
    return out
