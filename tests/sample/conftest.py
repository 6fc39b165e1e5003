"""A tiny clip of random pictures on an empty background, and a function that records it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fracsim import Scene

from .recording import FRAMES, HEIGHT, HISTORY, TRACKS, WIDTH, Clip, add, open_writer, tiny


@pytest.fixture(scope="session")
def clip() -> Clip:
    rng = np.random.default_rng(5)
    alpha = np.zeros((FRAMES, HEIGHT, WIDTH), np.float32)
    alpha[:, 10:40, 12:50] = rng.random((FRAMES, 30, 38))
    cover = alpha[..., None]
    scalars = {"strain": 2.0, "stress": 7e3, "damage": 1.0}
    maps = {name: (size * rng.random(cover.shape) * cover).astype(np.float32) for name, size in scalars.items()}
    maps["flow"] = (rng.uniform(-1.5, 1.0, (*alpha.shape, 2)) * cover).astype(np.float32)
    maps["damage"][0] = maps["flow"][0] = 0  # at rest
    return Clip(
        rgb=rng.integers(0, 256, (*alpha.shape, 3), dtype=np.uint8),
        alpha=alpha,
        maps=maps,
        xy=rng.uniform(0, WIDTH, (FRAMES, TRACKS, 2)).astype(np.float32),
        visible=rng.random((FRAMES, TRACKS)) > 0.5,
        particles=np.arange(TRACKS) * 11,
    )


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return tiny(tmp_path / "out")


@pytest.fixture
def record(clip: Clip) -> Callable[[Scene], Path]:
    """A function that makes the complete sample of a scene."""

    def make(scene: Scene) -> Path:
        with open_writer(scene) as writer:
            writer.track(clip.particles)
            add(writer, clip, scene)
            return writer.finish({"break_frame": 3}, HISTORY, {"simulate": 1.5})

    return make
