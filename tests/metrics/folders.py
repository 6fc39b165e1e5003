"""Folders of predicted and true clips for the tests of `fracgen.evaluate`, made in no time."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fracgen.config.evaluate import EvaluateConfig, Scores
from fracgen.evaluation import job
from fracsim import Camera, Capture, Output, Scene
from fracsim.records import Array
from fracsim.sample import Header, Writer, header_of, map_infos
from fracsim.sample.header import MapInfo
from fracsim.sample.video import Encoder
from fracsim.scene.vocab import Asset, Loading
from tests.dataset.tiny import report

METRIC = str(Path(__file__).with_name("brightness.py"))
FRAMES, HEIGHT, WIDTH = 6, 32, 48
MAPS = ("flow", "strain", "stress", "damage")


def arrays(seed: int, frames: int, height: int, width: int) -> tuple[Array, Array, dict[str, Array]]:
    """rgb, alpha and maps of a random clip; black where alpha is 0."""
    rng = np.random.default_rng(seed)
    alpha = np.zeros((frames, height, width), np.float32)
    alpha[:, height // 4 : -height // 4, width // 4 : -width // 4] = 1
    maps = {"flow": rng.normal(size=(*alpha.shape, 2)), "strain": rng.random((*alpha.shape, 1)),
            "stress": 5e3 * rng.random((*alpha.shape, 1)), "damage": rng.random((*alpha.shape, 1))}  # fmt: skip
    maps = {name: (value * alpha[..., None]).astype(np.float32) for name, value in maps.items()}
    return rng.integers(0, 256, (*alpha.shape, 3), dtype=np.uint8), alpha, maps


def truth(folder: Path, name: str = "duck", seed: int = 0, frames: int = FRAMES, factor: int = 1,
          look: int | None = None, **loading: Any) -> Path:  # fmt: skip
    """A simulated clip of random pictures, those of `look`, `factor` times 48 x 32 px."""
    height, width = factor * HEIGHT, factor * WIDTH
    scene = Scene(capture=Capture(frames=frames, tracks=3, report=False, strip=False), seed=seed,
                  camera=Camera(width=width, height=height), output=Output(folder=str(folder)),
                  asset=replace(Asset(), name=name), loading=replace(Loading(), **loading))  # fmt: skip
    rgb, alpha, maps = arrays(seed if look is None else look, frames, height, width)
    xy = np.array([[1.0, 2.0], [8.0, 8.0], [20.0, 10.0]], np.float32) * factor
    with Writer(header_of(scene), scene.output) as writer:
        for k in range(frames):
            writer.add(k, rgb[k], alpha[k], {n: maps[n][k] for n in MAPS}, (xy + factor * k, np.ones(3, bool)))
        return writer.finish(report(3), {"t": np.arange(frames)}, {"simulate": 1.0})


def generated(folder: Path, of: Path, look: int = 7, frames: int = FRAMES, maps: Sequence[str] = MAPS, fps: float = 100,
              encoding: Any = None, stage: int = 3, size: tuple[int, int] = (HEIGHT, WIDTH)) -> Path:  # fmt: skip
    """A generated clip of the simulated one in the folder `of`, with random pictures, maps in [0, 1]."""
    infos = map_infos(maps)
    infos = {name: info if info.scale else MapInfo(info.label, "1", info.channels, 1.0) for name, info in infos.items()}
    rgb, _, values = arrays(look, frames, *size)
    header = Header(producer="fracgen", version="0.0", content={"clip": of.name, "asset.name": "duck", "look": look},
                    document={"run": {"stage": stage, "streams": ["rgb", *maps], "config": {"seed": 0}}},
                    width=size[1], height=size[0], frames=frames, fps=fps, maps=infos,
                    about={"encoding": encoding} if encoding else {})  # fmt: skip
    with Writer(header, Output(folder=str(folder))) as writer:
        for k in range(frames):
            shown = {name: np.clip(values[name][k] / (5e3 if name == "stress" else 1), -1, 1) for name in maps}
            writer.add(k, rgb[k], None, shown)
        return writer.finish({})


def film(path: Path, frames: Array) -> Path:
    """A lossless video file of frames (T, H, W, 3) uint8."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with Encoder(path, frames.shape[2], frames.shape[1], "rgb") as encoder:
        for frame in frames:
            encoder.write(frame)
    return path


def grey(level: int, frames: int = FRAMES, height: int = HEIGHT, width: int = WIDTH) -> Array:
    """Frames of one grey, (T, H, W, 3) uint8."""
    return np.full((frames, height, width, 3), level, np.uint8)


def config(folder: Path, **changes: Any) -> EvaluateConfig:
    """An evaluation of `folder`/pred against `folder`/gt into `folder`/out, without controls and plots."""
    return EvaluateConfig(**{
        "pred": str(folder / "pred"), "gt": str(folder / "gt"), "outside": [METRIC], "controls": [], "plots": False,
        "resamples": 20, "output": Scores(folder=str(folder / "out")), **changes,
    })  # fmt: skip


def results(done: job.Done, metric: str = "brightness") -> dict[str, float]:
    """The values of a metric by name."""
    return {name: one["value"] for name, one in done.document["metrics"][metric]["results"].items()}
