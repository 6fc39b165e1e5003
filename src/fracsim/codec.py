"""Recorded maps to video in [0, 1] and back, the encoding a video model is trained on.

Scalars become grey, vectors the colour wheel of Baker et al. 2011 (Middlebury) on black: hue is the direction, value
the magnitude. Both are divided by a scale, one number a clip, and zero is black.
"""

import numpy as np

from fracsim.records import Array

_ARCS = (15, 6, 4, 11, 13, 6)
"""Steps of the Middlebury wheel from red to yellow, green, cyan, blue, magenta and back to red: 55 colours."""
_KNOTS = 2 * np.pi * np.cumsum((0, *_ARCS)) / (sum(_ARCS) - 1)
"""Direction at which each of these colours lies, clockwise from image right [rad], (7,).

A turn has 54 steps in the original, from its first colour to its last one. So the wheel has a seam at image right,
where the last colour, (255, 0, 42), meets the first one, red; and the last knot lies beyond a turn.
"""
_SEAM = 1e-4
"""Directions this close above image right [rad] count as image right, so that rounding does not cross the seam."""
_CORNERS = np.arange(7.0)


def scale(raw: Array, percentile: float = 100.0) -> float:
    """The magnitude shown as 1: a percentile of what is not background in a clip [..., C]; 1 when all is zero."""
    magnitude = np.linalg.norm(raw, axis=-1)
    foreground = magnitude[magnitude > 0]
    return float(np.percentile(foreground, percentile)) if foreground.size else 1.0


def encode(raw: Array, scale: float) -> Array:
    """A map [..., 1] or [..., 2] in physical units as RGB in [0, 1], [..., 3] float32; beyond `scale` is clipped.

    Raises ValueError for a scale that is not positive, or another number of channels.
    """
    _check(scale, raw.shape[-1])
    if raw.shape[-1] == 1:
        grey = np.clip(np.asarray(raw, np.float32) / np.float32(scale), 0, 1)
        return np.repeat(grey, 3, axis=-1)
    magnitude = np.clip(np.hypot(raw[..., 0], raw[..., 1]) / scale, 0, 1)
    return np.asarray(magnitude[..., None] * _hue(raw), np.float32)


def decode(video: Array, scale: float, channels: int) -> Array:
    """The map [..., channels] float32 in physical units that `encode` showed as RGB [..., 3]."""
    _check(scale, channels)
    if channels == 1:
        return np.asarray(video.mean(axis=-1, keepdims=True) * scale, dtype=np.float32)
    magnitude = np.clip(video.max(axis=-1), 0, 1) * scale
    angle = np.minimum(np.interp(_sextant(video), _CORNERS, _KNOTS), 2 * np.pi)
    return np.stack([magnitude * np.cos(angle), -magnitude * np.sin(angle)], axis=-1).astype(np.float32)


def _check(scale: float, channels: int) -> None:
    if not 0 < scale < np.inf:
        raise ValueError(
            f"scale={scale} must be positive and finite: take codec.scale(raw), or the clip's from meta.json."
        )
    if channels not in (1, 2):
        raise ValueError(f"channels={channels}: only scalars (1) and vectors in the image plane (2) have an encoding.")


def _hue(vector: Array) -> Array:
    """Fully saturated colour of the direction of (right, up) vectors [..., 2], [..., 3]; its largest part is 1."""
    # arctan2(-0.0, -x) is -pi where arctan2(0.0, -x) is pi: the modulus makes them equal.
    angle = np.mod(np.arctan2(-vector[..., 1], vector[..., 0], dtype=np.float64), 2 * np.pi)
    angle = np.where(angle > 2 * np.pi - _SEAM, 0, angle)
    h = np.interp(angle, _KNOTS, _CORNERS)
    return np.asarray(np.clip(np.stack([np.abs(h - 3) - 1, 2 - np.abs(h - 2), 2 - np.abs(h - 4)], axis=-1), 0, 1))


def _sextant(rgb: Array) -> Array:
    """Hue of RGB [..., 3] on the colour hexagon, in [0, 6); 0 where there is none."""
    rgb = np.asarray(rgb, np.float64)
    r, g, b = np.moveaxis(rgb, -1, 0)
    top, chroma = rgb.max(axis=-1), np.ptp(rgb, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        h = np.where(top == r, (g - b) / chroma, np.where(top == g, 2 + (b - r) / chroma, 4 + (r - g) / chroma))
    return np.where(chroma > 0, np.mod(h, 6), 0)
