"""Structural similarity of colour (Wang et al. 2004), a picture at a time, never as a volume; higher is better.

A Gaussian of 1.5 px, 11 x 11; K1 = 0.01, K2 = 0.03, a range of 1; each channel by itself; borders mirrored, as
torchmetrics does. In float64: where both pictures are flat, as background is, variances are differences of equal
numbers, and in float32 two equal pictures can score 0.999.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from fracgen.evaluation.per_frame import PerFrame
from fracsim.records import Array
from fracsim.scene.knob import check

SIGMA = 1.5
"""Standard deviation of the window [px]."""
RADIUS = 5
"""Its half width [px]."""
C1, C2 = 0.01**2, 0.03**2


@dataclass(kw_only=True)
class Settings:
    """None: the numbers are the publication's."""

    def __post_init__(self) -> None:
        check(self, "metric.ssim")


class Ssim(PerFrame):
    """See above."""

    name, better = "ssim", True

    def scores(self, pred: Array, true: Array) -> Array:
        """The similarity of each frame of two videos (T, H, W, 3) uint8, (T,)."""
        return np.array([similarity(a, b) for a, b in zip(pred, true, strict=True)])

    def about(self) -> dict[str, Any]:
        """The window."""
        return {"window": f"Gaussian {2 * RADIUS + 1} x {2 * RADIUS + 1}, {SIGMA} px", "borders": "mirrored"}


def similarity(a: Array, b: Array) -> float:
    """Of two pictures (H, W, 3) uint8."""
    a, b = a / 255, b / 255
    mean_a, mean_b = _blur(a), _blur(b)
    product, squares = mean_a * mean_b, mean_a**2 + mean_b**2
    covariance = _blur(a * b) - product
    variances = _blur(a * a + b * b) - squares
    return float(np.mean((2 * product + C1) * (2 * covariance + C2) / ((squares + C1) * (variances + C2))))


def _blur(picture: Array) -> Array:
    """A picture (H, W, 3) as the window sees it."""
    return np.asarray(ndimage.gaussian_filter(picture, SIGMA, radius=RADIUS, mode="mirror", axes=(0, 1)))


def build(settings: Settings) -> Ssim:
    """The metric."""
    return Ssim()
