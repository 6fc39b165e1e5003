"""What the generator is told: the loading as two moving blobs, material and fracture as numbers in [-1, 1].

One set of functions for training, sampling and the annotation page; NumPy for pictures, torch for latents, no Taichi.
Shapes: B clips, F frames, G grips, T latent frames, H and W latent rows and columns of one stream, S streams.
"""

import math
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fracgen.layout import CHANNELS
from fracsim.camera import project, view_of
from fracsim.records import Array
from fracsim.scene.classes import TRAINING_FRAMES, class_of
from fracsim.scene.condition import Condition
from fracsim.scene.vocab import CENTRE, Scene

if TYPE_CHECKING:  # the annotation page needs no torch
    from torch import Tensor

CONDITION_CHANNELS = 32
"""16 of the force latent, then E, nu, low, high, onset, crit, then zeros."""
SCALARS = ("E", "nu", "low", "high", "onset", "crit")
"""Order of the numbers in [-1, 1]; they stand in channels 16 to 21."""
LOG_E, NU, STRETCH = (6.0, 3.0), (0.3, 0.2), (5.5, 4.5)
"""Centre and half width of the paper's ranges: log10 of E in Pa, nu, both stretches."""
BLOB = 1 / 24
"""Standard deviation of a blob in picture heights: 20 px of 480, as ForcePrompting (Gillman et al. 2026) draws it."""
RANGES = ("clamp", "warn", "fail")
"""What to do with a number outside [-1, 1]: clamp it, clamp it and warn, or raise ValueError."""


def of_scene(scene: Scene) -> Condition:
    """The condition of a simulated scene, whose grips are seen by its camera.

    The velocities are means over the frames of training. Seen from the front they are exact; an oblique camera sees a
    grip that comes nearer speed up, which `scene_paths` knows. Raises ValueError when a grip is behind the camera.
    """
    duration = max(min(scene.capture.frames, TRAINING_FRAMES) - 1, 1) / scene.capture.fps
    points = grip_points(scene, np.array([0.0, duration]))
    view = view_of(scene)
    px, _ = project(view, points.reshape(-1, 3))
    if not np.isfinite(px).all():
        raise ValueError("camera: a grip lies behind the camera, so it has no place in the picture; move the camera.")
    first, last = px.reshape(2, 2, 2) / (view.width, view.height)
    m, f = scene.material, scene.fracture
    return Condition(
        E=m.E, nu=m.nu, category=_category(scene), onset=f.onset, crit=f.crit,
        grips=first.ravel().tolist(), velocity=((last - first) / duration).ravel().tolist(), fps=scene.capture.fps,
    )  # fmt: skip


def _category(scene: Scene) -> str:
    """Kind of fracture of a scene: that of its object, or of its law if the object has none."""
    own = class_of(scene.asset.name) if scene.asset.kind == "builtin" else "none"
    return own if own != "none" else class_of(scene.material.law)


def grip_points(scene: Scene, times: Array) -> Array:
    """Centres of the two grips [m] at `times` [s], (F,), as prescribed, (F, 2, 3)."""
    load_, axis = scene.loading, np.array(scene.loading.axis)
    reach = load_.offset + load_.speed * np.asarray(times)[:, None]
    return np.stack([CENTRE - reach * axis, CENTRE + reach * axis], axis=1)


def scene_paths(scene: Scene, frames: int) -> Array:
    """Positions of the grips of a scene [px], (F, 2, 2), seen by its camera: exact also for oblique views."""
    points = grip_points(scene, np.arange(frames) / scene.capture.fps)
    px, _ = project(view_of(scene), points.reshape(-1, 3))
    return px.reshape(frames, 2, 2)


def blobs(paths: Array, width: int, height: int) -> Array:
    """The loading as a video in [0, 1], (F, height, width, 3) float32: white Gaussian blobs at `paths` [px], (F, G, 2).

    Blobs that overlap add up to at most 1. A grip outside the picture leaves it as any picture would.
    """
    spread = 2 * (BLOB * height) ** 2
    columns, rows = np.arange(width) + 0.5, np.arange(height) + 0.5
    x = np.exp(-((columns - paths[..., :1]) ** 2) / spread)  # (F, G, width)
    y = np.exp(-((rows - paths[..., 1:]) ** 2) / spread)  # (F, G, height)
    grey = np.clip(np.einsum("fgh,fgw->fhw", y, x), 0, 1).astype(np.float32)
    return np.repeat(grey[..., None], 3, axis=-1)


def scalars(condition: Condition, ranges: str = "warn") -> Array:
    """E, nu, low, high, onset and crit in [-1, 1], (6,) float32, in the order of SCALARS.

    `ranges` is one of RANGES. Raises ValueError with "fail" for a number outside the paper's ranges.
    """
    values = {
        "E": (math.log10(condition.E) - LOG_E[0]) / LOG_E[1],
        "nu": (condition.nu - NU[0]) / NU[1],
        "low": 1.0 if condition.category == "low_stretch" else -1.0,
        "high": 1.0 if condition.category == "high_stretch" else -1.0,
        "onset": (condition.onset - STRETCH[0]) / STRETCH[1],
        "crit": (condition.crit - STRETCH[0]) / STRETCH[1],
    }
    for name, value in values.items():
        if abs(value) > 1 + 1e-6 and ranges != "clamp":
            _outside(name, getattr(condition, name), ranges)
    return np.clip(np.array([values[name] for name in SCALARS], np.float32), -1, 1)


LIMITS = {"E": "1e3 to 1e9 Pa", "nu": "0.1 to 0.5", "onset": "1 to 10", "crit": "1 to 10"}
"""Ranges of the paper, which become [-1, 1]."""


def _outside(name: str, value: float, ranges: str) -> None:
    """Warn of, or refuse, a number outside the ranges that the network knows."""
    text = f"condition.{name}={value:g} is outside {LIMITS[name]}, which is what the network knows"
    if ranges == "fail":
        raise ValueError(f"{text}: bring it inside, or set ranges=clamp (conditioning.ranges in a training).")
    warnings.warn(f"{text}: it is clamped.", stacklevel=3)


def physical(numbers: Sequence[float]) -> dict[str, Any]:
    """E [Pa], nu, category, onset and crit of the numbers that `scalars` gives, (6,); its inverse inside the ranges."""
    v = dict(zip(SCALARS, map(float, numbers), strict=True))
    return {
        "E": 10 ** (LOG_E[0] + LOG_E[1] * v["E"]),
        "nu": NU[0] + NU[1] * v["nu"],
        "category": "low_stretch" if v["low"] > v["high"] else "high_stretch",
        "onset": STRETCH[0] + STRETCH[1] * v["onset"],
        "crit": STRETCH[0] + STRETCH[1] * v["crit"],
    }


def channels(force: "Tensor", numbers: "Tensor", streams: int, height: str = "tile", gain: float = 1.0) -> "Tensor":
    """The condition channels [B, 32, T, S H, W] of a force latent [B, 16, T, H, W] and `numbers` [B, 6].

    `height`: "tile" repeats them for each stream, so that every map sees the force where it acts; "rgb_only" leaves
    zeros beside the maps, as for the reference. The numbers are multiplied by `gain`.
    """
    import torch

    assert height in ("tile", "rgb_only"), height
    b, c, t, h, w = force.shape
    assert (c, *numbers.shape) == (CHANNELS, b, len(SCALARS)), (force.shape, numbers.shape)
    flat = (gain * numbers).to(force)[:, :, None, None, None].expand(-1, -1, t, h, w)
    rest = force.new_zeros(b, CONDITION_CHANNELS - c - len(SCALARS), t, h, w)
    one = torch.cat([force, flat, rest], dim=1)
    others = [one if height == "tile" else torch.zeros_like(one)] * (streams - 1)
    return torch.cat([one, *others], dim=-2)
