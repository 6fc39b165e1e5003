"""Data sets of tiny clips with random pictures, made without a simulation."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fracsim import Camera, Capture, Output, Scene
from fracsim.records import Array
from fracsim.sample import Writer, header_of
from fracsim.scene.vocab import Asset, Loading

WIDTH, HEIGHT, FRAMES = 32, 48, 6
OBJECTS = ("duck", "bear", "croissant", "star")
QUIET = {"grip_work": 1.0, "gravity_work": 0.0, "unaccounted": 0.0}


def scenes(folder: Path, count: int, width: int = WIDTH, height: int = HEIGHT) -> list[Scene]:
    """As many scenes of four objects; a later one differs from its default in more fields."""
    base = Scene(capture=Capture(frames=FRAMES, tracks=3, report=False, strip=False), output=Output(folder=str(folder)),
                 camera=Camera(width=width, height=height))  # fmt: skip
    return [replace(base, seed=k // 4, asset=replace(Asset(), name=OBJECTS[k % 4]),
                    loading=replace(Loading(), speed=1.0 + k)) for k in range(count)]  # fmt: skip


def pictures(seed: int, width: int = WIDTH, height: int = HEIGHT) -> tuple[Array, Array, dict[str, Array]]:
    """rgb, alpha and maps of a clip; an object of random coverage on an empty background."""
    rng = np.random.default_rng(seed)
    alpha = np.zeros((FRAMES, height, width), np.float32)
    alpha[:, 8:40, 6:27] = rng.random((FRAMES, 32, 21))
    maps = {name: (size * rng.random((*alpha.shape, 1)) * alpha[..., None]).astype(np.float32)
            for name, size in {"strain": 2.0, "stress": 7e3, "damage": 1.0}.items()}  # fmt: skip
    maps["flow"] = (rng.uniform(-1.5, 1.0, (*alpha.shape, 2)) * alpha[..., None]).astype(np.float32)
    return rng.integers(0, 256, (*alpha.shape, 3), dtype=np.uint8), alpha, maps


def report(broken: int | None, **more: Any) -> dict[str, Any]:
    return {"break_frame": broken, "torn_frame": None, "particles": 9, "substeps": 9, "clamped": 0, "energy": QUIET,
            **more}  # fmt: skip


WILD = (2, 0, 20, 15, 1e9)
"""Frame, channel, row, column and value [Pa] of a wild pixel of the stress map."""


def record(scene: Scene, seed: int, wild: bool = False, **summary: Any) -> Path:
    """The sample of a scene, with a wild pixel if wanted."""
    rgb, alpha, maps = pictures(seed, scene.camera.width, scene.camera.height)
    if wild:
        frame, channel, row, column, value = WILD
        maps["stress"][frame, row, column, channel] = value
    xy = np.full((3, 2), 16, np.float32)
    with Writer(header_of(scene), scene.output) as writer:
        for k in range(FRAMES):
            chosen = {name: maps[name][k] for name in scene.capture.maps}
            writer.add(k, rgb[k], alpha[k], chosen, (xy + k, np.ones(3, bool)))
        return writer.finish(report(**summary), {"t": np.arange(FRAMES)}, {"simulate": 1.0})


def make(folder: Path, count: int, width: int = WIDTH, height: int = HEIGHT) -> Path:
    """A data set. No clip breaks or is wild but that of the largest id: loaders take types from the first clips."""
    made = scenes(folder, count, width, height)
    last = max(header_of(scene).id for scene in made)
    for k, scene in enumerate(made):
        at_last = header_of(scene).id == last
        record(scene, k, wild=at_last, broken=3 if at_last else None)
    return folder
