"""Clips for feature distances, features of known moments, and a network that counts its calls."""

from pathlib import Path

import numpy as np
from scipy.fft import dct

from fracgen.evaluation.clip import Clip, Pair
from fracsim.records import Array

COUNTING = '''
from dataclasses import dataclass
import numpy as np

calls = []

@dataclass(kw_only=True)
class Settings:
    weights: str = ""

class Network:
    """The mean of each channel; NaN for a black clip."""

    least = 2

    def about(self):
        return {"network": "means", "sha256": "0" * 64}

    def __call__(self, video):
        calls.append(len(video))
        return video.mean((0, 1, 2)) if video.any() else np.full(3, np.nan)

def build(settings):
    return Network()
'''


def counting(folder: Path) -> str:
    """The path of a network from outside whose list `calls` holds the frames of each call."""
    path = folder / "counting.py"
    path.write_text(COUNTING)
    return str(path)


def video(seed: int, frames: int = 16, size: int = 8) -> Array:
    """Random pixels, (T, size, size, 3) uint8."""
    return np.random.default_rng(seed).integers(1, 256, (frames, size, size, 3), np.uint8)


def clip(name: str, rgb: Array) -> Clip:
    """A clip of a video (T, H, W, 3)."""
    return Clip(name, *rgb.shape[:3], 100, {"rgb": lambda: rgb})


def pair(seed: int, frames: int = 16) -> Pair:
    """A pair of random clips."""
    return Pair(clip("pred", video(2 * seed, frames)), clip("gt", video(2 * seed + 1, frames)))


def gaussian(mean: Array, root: Array, n: int) -> Array:
    """Features (n, D) of mean (D,) and of covariance root^T root, over n - 1, where root is (K, D), K < n."""
    waves = dct(np.eye(n), norm="ortho")[:, 1 : len(root) + 1]  # orthonormal columns of zero sum
    return mean + np.sqrt(n - 1) * waves @ root
