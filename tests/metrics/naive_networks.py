"""Perceptual distances in plain NumPy and float64, written from the publications: loops over layers, no torch."""

from collections.abc import Mapping

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fracsim.records import Array

ALEX = ("conv 0 4 2", "tap", "max 3 2", "conv 3 1 2", "tap", "max 3 2", "conv 6 1 1", "tap", "conv 8 1 1", "tap",
        "conv 10 1 1", "tap")  # fmt: skip
"""Convolutions by their number in the weights, stride and padding; poolings by size and stride; ReLUs that are taps."""
VGG = tuple(
    f"conv {number} 1 1" if number >= 0 else {-1: "relu", -2: "tap", -3: "max 2 2"}[number]
    for number in (0, -1, 2, -2, -3, 5, -1, 7, -2, -3, 10, -1, 12, -1, 14, -2, -3, 17, -1, 19, -1, 21, -2, -3,
                   24, -1, 26, -1, 28, -2)
)  # fmt: skip
SHIFT_TOLERANT = ("conv 0 1 2", "blur", "tap", "max 3 1", "blur", "conv 5 1 2", "tap", "max 3 1", "blur", "conv 9 1 1",
                  "tap", "conv 11 1 1", "tap", "conv 13 1 1", "tap")  # fmt: skip


def windows(x: Array, size: int, stride: int) -> Array:
    """Squares of a picture (C, H, W), (C, h, w, size, size)."""
    return sliding_window_view(x, (size, size), axis=(1, 2))[:, ::stride, ::stride]


def padded(x: Array, by: int, mode: str) -> Array:
    """A picture (C, H, W) with a border of `by` pixels."""
    return np.pad(x, ((0, 0), (by, by), (by, by)), mode)  # type: ignore[call-overload]


def taps(plan: tuple[str, ...], convolutions: Mapping[str, Array], picture: Array) -> list[Array]:
    """What a plan compares of a picture (3, H, W) in [0, 1], with `NUMBER.weight` and `NUMBER.bias` by name."""
    mean, spread = np.array([-0.030, -0.088, -0.188]), np.array([0.458, 0.448, 0.450])
    x = (2 * picture - 1 - mean[:, None, None]) / spread[:, None, None]
    out = []
    for step in plan:
        what, *numbers = step.split()
        a, *more = map(int, numbers or [0])
        if what == "conv":
            weight = convolutions[f"{a}.weight"].astype(np.float64)
            squares = windows(padded(x, more[1], "constant"), weight.shape[-1], more[0])
            x = np.einsum("chwij,ocij->ohw", squares, weight, optimize=True)
            x = x + convolutions[f"{a}.bias"].astype(np.float64)[:, None, None]
        elif what == "max":
            x = windows(x, a, more[0]).max(axis=(-1, -2))
        elif what == "blur":
            kernel = np.outer([1, 2, 1], [1, 2, 1]) / 16
            x = (windows(padded(x, 2, "reflect"), 3, 2) * kernel).sum(axis=(-1, -2))
        else:
            x = np.maximum(x, 0)
            out += [x] if what == "tap" else []
    return out


def distance(plan: tuple[str, ...], convolutions: Mapping[str, Array], heads: list[Array], pictures: Array) -> float:
    """The distance of two pictures, (2, H, W, 3) uint8; heads (C,) a tap."""
    found = [taps(plan, convolutions, picture.transpose(2, 0, 1) / 255) for picture in pictures]
    total = 0.0
    for a, b, head in zip(*found, heads, strict=True):
        a, b = (x / (np.sqrt((x * x).sum(axis=0)) + 1e-10) for x in (a, b))
        total += float((head[:, None, None] * (a - b) ** 2).sum(axis=0).mean())
    return total
