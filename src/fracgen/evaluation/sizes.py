"""One size for both clips of a pair: the larger one is averaged over its pixels."""

from typing import NamedTuple

import numpy as np

from fracgen.data import pictures
from fracsim.records import Array

SHAPE = 0.01
"""Largest relative difference of width over height at which two pictures have one shape."""


class Shrink(NamedTuple):
    """How pictures get to the size of a pair."""

    factor: float
    """Pixels of theirs along the edge of one of the pair's."""
    height: int
    width: int

    def __call__(self, frames: Array) -> Array:
        """Pictures [F, H, W, C] in the size of the pair, [F, h, w, C]; as they are for a factor of 1."""
        if frames.shape[1:3] == (self.height, self.width):
            return frames
        if self.factor == int(self.factor):
            return pictures.shrink(frames, int(self.factor))
        return _area(frames, self.height, self.width)


def common(pred: tuple[int, int], gt: tuple[int, int], resize: str) -> tuple[Shrink, Shrink]:
    """How two clips of these widths and heights [px] get to the size of the smaller one.

    Raises ValueError when they do not.
    """
    width, height = min(pred, gt)
    factors = [size[0] / width for size in (pred, gt)]
    whole = all(size == (width * size[0] // width, height * (size[0] // width)) for size in (pred, gt))
    alike = all(abs(size[0] / size[1] * height / width - 1) < SHAPE for size in (pred, gt))
    told = f"it has {pred[0]} x {pred[1]} px, and its true clip {gt[0]} x {gt[1]}"
    if not alike:
        raise ValueError(f"{told}: the shapes differ; crop one of them")
    if not whole and resize == "whole":
        raise ValueError(f"{told}, no whole multiple: resize=any averages all the same")
    first, second = (Shrink(factor, height, width) for factor in factors)
    return first, second


def _area(frames: Array, height: int, width: int) -> Array:
    """Pictures [F, H, W, C] averaged over areas, [F, h, w, C] float32; frame by frame, to save memory."""
    rows, columns = _weights(frames.shape[1], height), _weights(frames.shape[2], width)
    out = np.empty((len(frames), height, width, frames.shape[-1]), np.float32)
    for k, frame in enumerate(frames):
        out[k] = np.einsum("hH,HWc,wW->hwc", rows, frame.astype(np.float32), columns, optimize=True)
    return out


def _weights(many: int, few: int) -> Array:
    """The share of each of `many` cells of a line in each of `few`, (few, many), rows sum to 1."""
    edges = np.arange(many + 1) * (few / many)
    overlap = np.minimum(edges[None, 1:], np.arange(1, few + 1)[:, None]) - np.maximum(
        edges[None, :-1], np.arange(few)[:, None])  # fmt: skip
    return np.asarray(np.clip(overlap, 0, None), np.float32)
