"""Decoder of EXT_meshopt_compression and KHR_meshopt_compression: buffer views of glTF files that gltfpack writes.

Follows the bitstream of the extensions' specifications, versions 0 and 1. Vertices are stored byte by byte in blocks,
as differences to the vertex before; triangles as codes into short histories of edges and vertices.
"""

import numpy as np

from fracsim.records import Array

BLOCK_BYTES, BLOCK, GROUP = 8192, 256, 16
"""Most bytes and vertices of a block, and vertices of a group."""
WIDTHS = {0: (0, 2, 4, 8), 1: (0, 1, 2, 4), 2: (1, 2, 4, 8)}
"""Bits a byte of a group by its mode: in version 0, and in version 1 with control bits 0 and 1."""


def decode(data: bytes, count: int, stride: int, mode: str, kind: str = "NONE") -> bytes:
    """`count` elements of `stride` bytes of a compressed buffer view.

    `mode` is ATTRIBUTES, TRIANGLES or INDICES, `kind` the filter. Raises ValueError for data that is damaged.
    """
    try:
        if mode == "ATTRIBUTES":
            return bytes(FILTERS[kind](_vertices(np.frombuffer(data, np.uint8), count, stride)).tobytes())
        indices = _triangles(data, count // 3) if mode == "TRIANGLES" else _sequence(data, count)
        return np.array(indices, np.int64).astype("<u2" if stride == 2 else "<u4").tobytes()
    except (IndexError, KeyError, ValueError) as error:
        raise ValueError(f"damaged meshopt data of mode {mode} and filter {kind}") from error


def _vertices(data: Array, count: int, stride: int) -> Array:
    """Vertices as bytes (count, stride)."""
    version = int(data[0]) & 15
    if data[0] >> 4 != 10 or version > 1:
        raise ValueError
    tail = data[len(data) - stride - (stride // 4 if version else 0) :]
    last, channels = tail[:stride].copy(), tail[stride:] if version else np.zeros(stride // 4, np.uint8)
    block = min((BLOCK_BYTES // stride) & ~(GROUP - 1), BLOCK)
    out, at = np.empty((count, stride), np.uint8), 1
    for start in range(0, count, block):
        n = min(block, count - start)
        control = data[at : at + stride // 4]
        at += stride // 4 if version else 0
        deltas = np.zeros((stride, -(-n // GROUP) * GROUP), np.uint8)
        for k in range(stride):
            how = int(control[k // 4]) >> 2 * (k % 4) & 3 if version else 0
            if how == 3:  # as they are, without modes
                deltas[k, :n], at = data[at : at + n], at + n
            elif how != 2:  # all zero
                at = _groups(data, at, deltas[k], WIDTHS[how + 1 if version else 0])
        out[start : start + n] = _summed(deltas[:, :n], last, channels)
        last = out[start + n - 1].copy()
    return out


def _groups(data: Array, at: int, out: Array, widths: tuple[int, ...]) -> int:
    """Fills `out` (16 groups,) from the modes and groups at a place in `data`; returns the place after them."""
    groups = len(out) // GROUP
    modes = data[at : at + -(-groups // 4)]
    at += len(modes)
    for g in range(groups):
        bits = widths[int(modes[g // 4]) >> 2 * (g % 4) & 3]
        part = out[GROUP * g : GROUP * (g + 1)]
        if bits == 8:
            part[:], at = data[at : at + GROUP], at + GROUP
        elif bits:
            raw = np.unpackbits(data[at : at + 2 * bits], bitorder="little" if bits == 1 else "big")
            part[:] = raw.reshape(GROUP, bits) @ (1 << np.arange(bits)[::-1])
            at += 2 * bits
            full = np.flatnonzero(part == (1 << bits) - 1)  # these stand for bytes that follow
            part[full], at = data[at : at + len(full)], at + len(full)
    return at


def _summed(deltas: Array, last: Array, channels: Array) -> Array:
    """Vertices (n, stride) of the differences of their bytes, (stride, n), after the vertex `last` (stride,)."""
    out = np.empty(deltas.T.shape, np.uint8)
    for k, channel in enumerate(channels):
        four = np.ascontiguousarray(deltas[4 * k : 4 * k + 4].T)
        kind = channel & 3
        if kind == 2:  # exclusive or of rotated words
            word, turn = four.view("<u4")[:, 0], int(channel) >> 4
            word = word >> turn | (word << (32 - turn) if turn else 0)
            first = np.ascontiguousarray(last[4 * k : 4 * k + 4]).view("<u4")
            words = np.bitwise_xor.accumulate(np.concatenate([first, word.astype("<u4")]))[1:]
            out[:, 4 * k : 4 * k + 4] = words.astype("<u4")[:, None].view(np.uint8)
            continue
        if kind == 3:
            raise ValueError
        code = four.view("<u2" if kind else np.uint8).astype(np.int64)
        before = np.ascontiguousarray(last[4 * k : 4 * k + 4]).view("<u2" if kind else np.uint8)
        total = before + np.cumsum(code >> 1 ^ -(code & 1), axis=0)
        out[:, 4 * k : 4 * k + 4] = np.ascontiguousarray(total.astype("<u2" if kind else np.uint8)).view(np.uint8)
    return out


def _octahedral(v: Array) -> Array:
    """Unit vectors from their octahedral map: two components, and the value of one."""
    x, y, one, w = v.view("<i1" if v.shape[1] == 4 else "<i2").astype(np.float64).T
    x, y = x / one, y / one
    z = 1 - np.abs(x) - np.abs(y)
    t = np.maximum(-z, 0)
    x, y = x - np.where(x >= 0, t, -t), y - np.where(y >= 0, t, -t)
    scale = (127 if v.shape[1] == 4 else 32767) / np.sqrt(x * x + y * y + z * z)
    out = np.stack([*(np.rint(a * scale) for a in (x, y, z)), w], axis=1)
    return out.astype("<i1" if v.shape[1] == 4 else "<i2")


def _quaternion(v: Array) -> Array:
    """Unit quaternions of three components and, in the last two bits, which one is missing."""
    q = v.view("<i2").astype(np.int64)
    three = q[:, :3] * (np.sqrt(0.5) / (q[:, 3] | 3))[:, None]
    rest = np.sqrt(np.maximum(0.0, 1 - (three**2).sum(axis=1)))
    out, missing = np.empty((len(q), 4)), q[:, 3] & 3
    for k, part in enumerate((rest, *three.T)):
        out[np.arange(len(q)), (missing + k) % 4] = part
    return np.asarray(np.rint(32767 * out).astype("<i2"))


def _exponential(v: Array) -> Array:
    """Numbers of a signed exponent in eight bits above a signed mantissa in 24."""
    word = v.view("<i4")
    return np.asarray(np.ldexp(((word << 8) >> 8).astype(np.float64), word >> 24).astype("<f4"))


def _colour(v: Array) -> Array:
    """Red, green, blue and alpha of luma, two chroma differences, and an alpha whose top bit gives the width."""
    unsigned, signed, most = ("u1", "i1", 255) if v.shape[1] == 4 else ("<u2", "<i2", 65535)
    y, alpha = (v.view(unsigned)[:, k].astype(np.int64) for k in (0, 3))
    co, cg = (v.view(signed)[:, k].astype(np.int64) for k in (1, 2))
    full = (1 << np.floor(np.log2(np.maximum(alpha, 1))).astype(np.int64) + 1) - 1
    a = alpha & full >> 1
    parts = np.stack([y + co - cg, y + cg, y - co - cg, a << 1 | a & 1], axis=1)
    return np.asarray(np.clip(np.rint(parts * (most / full)[:, None]), 0, most).astype(unsigned))


FILTERS = {"NONE": lambda v: v, "OCTAHEDRAL": _octahedral, "QUATERNION": _quaternion, "EXPONENTIAL": _exponential,
           "COLOR": _colour}  # fmt: skip


class _Bytes:
    """Numbers of variable length, one after the other."""

    def __init__(self, data: bytes, at: int) -> None:
        self.data, self.at, self.last = data, at, 0

    def number(self) -> int:
        """The next number: seven bits a byte, the lowest first."""
        value, shift = 0, 0
        while True:
            byte = self.data[self.at]
            self.at += 1
            value |= (byte & 127) << shift
            if byte < 128:
                return value
            shift += 7

    def index(self) -> int:
        """The next index: a signed difference to the last one."""
        code = self.number()
        self.last += code >> 1 ^ -(code & 1)
        return self.last


def _triangles(data: bytes, count: int) -> list[int]:
    """Indices of `count` triangles, one after the other."""
    if data[0] != 0xE1:
        raise ValueError
    rest, table = _Bytes(data, 1 + count), data[len(data) - 16 :]
    edges: list[tuple[int, int]] = [(0, 0)] * 16
    recent: list[int] = [0] * 16
    out: list[int] = []
    fresh = 0
    for code in data[1 : 1 + count]:
        high, low = code >> 4, code & 15
        if high < 15:
            a, b = edges[-1 - high]
            if low in (13, 14):
                rest.last += 1 if low == 14 else -1
            c = fresh if low == 0 else recent[-1 - low] if low < 13 else rest.index() if low == 15 else rest.last
            fresh += low == 0
            if not 0 < low < 13:
                recent.append(c)
            edges += [(c, b), (a, c)]
        else:
            pair = table[low] if low < 14 else rest.data[rest.at]
            rest.at += low >= 14
            fresh = 0 if low >= 14 and pair == 0 else fresh
            corners = []
            for which in (15 if low == 15 else 0, pair >> 4, pair & 15):
                known = low >= 14 and which == 15
                corners.append(fresh if which == 0 else rest.index() if known else recent[-which])
                fresh += which == 0
            # The history changes only after all three are known.
            recent += [
                v for v, w in zip(corners, (0, pair >> 4, pair & 15), strict=True) if w == 0 or w == 15 <= low + 1
            ]
            a, b, c = corners
            edges += [(b, a), (c, b), (a, c)]
        out += (a, b, c)
        if len(edges) > 4096:
            edges, recent = edges[-16:], recent[-16:]
    return out


def _sequence(data: bytes, count: int) -> list[int]:
    """`count` indices: differences to one of the last two, as the lowest bit says."""
    if data[0] != 0xD1:
        raise ValueError
    rest, last, out = _Bytes(data, 1), [0, 0], []
    for _ in range(count):
        code = rest.number()
        which, code = code & 1, code >> 1
        last[which] += code >> 1 ^ -(code & 1)
        out.append(last[which])
    return out
