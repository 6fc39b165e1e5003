"""Hand-made clips whose motion is known: a textured ellipse that is stretched along an axis and drifts."""

from typing import Any

import numpy as np
from scipy import ndimage

from fracgen.evaluation.clip import Clip, Pair
from fracsim.records import Array
from fracsim.sample.reader import Tracks

WHITE = 255


def clip(name: str = "clip", frames: int = 21, size: tuple[int, int] = (128, 128), **streams: Any) -> Clip:
    """A clip of `size` (height, width) that has these streams."""
    height, width = size
    return Clip(name, frames, height, width, 25.0, {key: lambda value=value: value for key, value in streams.items()})


def pair(pred: Clip, gt: Clip | None) -> Pair:
    return Pair(pred, gt)


def stretch(angle: float, along: float, across: float = 1.0) -> Array:
    """F, (2, 2), that stretches by `along` at `angle` [deg], counter-clockwise in a picture whose y points down."""
    c, s = np.cos(np.radians(angle)), -np.sin(np.radians(angle))
    R = np.array([[c, -s], [s, c]])
    return R @ np.diag([along, across]) @ R.T


def disk(n: int = 400, radius: float = 30.0, centre: tuple[float, float] = (64, 64), seed: int = 0) -> Array:
    """Points that are uniform on a disk, (n, 2) [px]; each has its mirror image, so that their mean is the centre."""
    rng = np.random.default_rng(seed)
    half = radius * np.sqrt(rng.random(n // 2))[:, None] * directions(rng.random(n // 2) * 360)
    return np.concatenate([half, -half]) + centre


def directions(degrees: Array) -> Array:
    return np.stack([np.cos(np.radians(degrees)), -np.sin(np.radians(degrees))], axis=-1)


def tracked(points: Array, moves: list[Array], size: tuple[int, int] = (128, 128), **more: Any) -> Clip:
    """A clip with tracks only: points (N, 2) under F (2, 2) about their mean, one F a frame; a mask all over."""
    centre = points.mean(axis=0)
    xy = np.stack([(points - centre) @ F.T + centre for F in moves])
    seen = np.ones(xy.shape[:2], bool)
    streams = {"tracks": Tracks(xy, seen, np.arange(len(points))), "alpha": np.ones((len(moves), *size), np.float32)}
    return clip(frames=len(moves), size=size, **(streams | more))


def ellipse(moves: list[tuple[Array, tuple[float, float]]], side: int = 128, texture: float = 1.5) -> Clip:
    """A clip of an ellipse under x = F X + drift [px] about its centre, an (F, drift) a frame, with its alpha.

    `texture` is the length of its pattern in pixels of a picture of 128.
    """
    pattern = ndimage.gaussian_filter(
        np.random.default_rng(0).standard_normal((side, side, 3)), (*[texture * side / 128] * 2, 0)
    )
    pattern = np.clip(110 + 60 * pattern / pattern.std(), 0, 220)
    rgb, alpha = zip(*(_picture(pattern, F, np.asarray(drift), side) for F, drift in moves), strict=True)
    return clip(frames=len(moves), size=(side, side), rgb=np.stack(rgb), alpha=np.stack(alpha))


def _picture(pattern: Array, F: Array, drift: Array, side: int) -> tuple[Array, Array]:
    centre = np.array([side / 2, side / 2])
    x = np.stack(np.meshgrid(*[np.arange(side) + 0.5] * 2), axis=-1)
    X = (x - centre - drift) @ np.linalg.inv(F).T
    inside = ((X / (0.3 * side, 0.22 * side)) ** 2).sum(axis=-1) < 1
    at = (X + centre - 0.5)[..., ::-1].transpose(2, 0, 1)
    colours = [ndimage.map_coordinates(pattern[..., c], at, order=1, mode="nearest") for c in range(3)]
    rgb = np.where(inside[..., None], np.stack(colours, axis=-1), WHITE)
    return np.rint(rgb).astype(np.uint8), inside.astype(np.float32)
