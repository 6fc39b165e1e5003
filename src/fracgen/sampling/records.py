"""Sampled clips as samples on disk, in the schema that fracsim writes."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fracgen import __version__
from fracgen.config.sample import SampleConfig
from fracgen.sampling.request import Request, truth
from fracgen.sampling.trained_run import TrainedRun
from fracsim import codec
from fracsim.records import Array
from fracsim.sample import Header, MapInfo, Writer, map_infos
from fracsim.sample.identity import sample_id
from fracsim.scene.vocab import Output

PRODUCER = "fracgen"
PACKAGES = ("torch", "diffusers", "transformers", "peft", "numpy", "imageio-ffmpeg")
LUMA = np.array([0.2126, 0.7152, 0.0722])
"""Weights of red, green and blue in the luminance (ITU-R BT.709)."""


@dataclass(frozen=True)
class Made:
    """What samples of one command have in common."""

    cfg: SampleConfig
    run: TrainedRun
    maps: tuple[str, ...]
    """Maps that are decoded."""
    sampler: Mapping[str, Any]
    """The solver and its settings, resolved."""

    @property
    def output(self) -> Output:
        """Where samples are written."""
        return Output(folder=self.cfg.output.folder, overwrite=self.cfg.output.overwrite)


def content(request: Request, made: Made) -> dict[str, Any]:
    """All that names a sample; the fields of a scene among it are columns of the table of a data set."""
    return {
        **request.fields,
        "seed": made.cfg.seed,
        "weights": made.run.weights,
        "base": made.run.about["base"],
        "networks": {name: made.run.cache[name] for name in ("vae", "text", "image")},
        "decoder": {"dtype": made.cfg.vae.dtype, "tile": made.cfg.vae.tile},
        "sampler": dict(made.sampler),
        "picture": request.picture,
        "condition": {**asdict(request.condition), "caption": request.caption},
        "clip": request.key,
        "maps": list(made.maps),
        "scales": made.cfg.scales,
    }


def identity(request: Request, made: Made) -> str:
    """The id of a sample."""
    return sample_id(PRODUCER, content(request, made))


def write(request: Request, made: Made, rgb: Array, videos: Mapping[str, Array], seconds: Mapping[str, float]) -> Path:
    """Write a sample and return its folder; `rgb` and `videos` are in [0, 1], (F, h, w, 3).

    Raises ValueError or OSError naming output.folder when it cannot be written.
    """
    infos = {name: _info(name, request, made) for name in videos}
    values = {name: codec.decode(video, infos[name].scale or 1.0, infos[name].channels)
              for name, video in videos.items()}  # fmt: skip
    frames, height, width = made.run.size
    header = Header(
        producer=PRODUCER,
        version=__version__,
        content=content(request, made),
        document={
            "config": asdict(made.cfg),
            "condition": asdict(request.condition),
            "caption": request.caption,
            "sampler": dict(made.sampler),
            "run": {name: made.run.about[name] for name in ("stage", "streams", "base", "model", "config")},
        },
        width=width,
        height=height,
        frames=frames,
        fps=made.run.cache["fps"],
        maps=infos,
        about={"encoding": encoding(made.run)},
        packages=PACKAGES,
    )
    pixels = np.rint(np.clip(rgb, 0, 1) * 255).astype(np.uint8)
    with Writer(header, made.output) as writer:
        for k, frame in enumerate(pixels):
            writer.add(k, frame, None, {name: value[k] for name, value in values.items()})
        return writer.finish(report=report(rgb, request.read()), seconds=seconds)


def encoding(run: TrainedRun) -> dict[str, Any]:
    """How simulated clips became those that the run was trained on: what tells which true frame belongs to which."""
    return {"frame_select": run.cache["frame_select"], "percentile": run.cache["normalisation"]["percentile"]}


def report(rgb: Array, picture: Array) -> dict[str, float]:
    """How the luminance of the whole picture, in [0, 1], changes where it should not: at the start of the clip.

    `luminance_offset` is that of frame 0 minus that of `picture`, (h, w, 3) uint8; `luminance_jump` that of frame 1
    minus that of frame 0. `rgb` is in [0, 1], (F, h, w, 3).
    """
    given = float((picture / 255 @ LUMA).mean())
    first, second = (float((frame @ LUMA).mean()) for frame in (rgb[0], rgb[min(1, len(rgb) - 1)]))
    return {"luminance_offset": first - given, "luminance_jump": second - first}


def _info(name: str, request: Request, made: Made) -> MapInfo:
    """What a predicted map holds: values in its unit where its scale is known, and else in [0, 1]."""
    info = map_infos([name])[name]
    if info.scale is not None:
        return info
    if made.cfg.scales == "truth":
        scale = truth(request, name, made.run, made.cfg.data)
        return MapInfo(info.label, info.unit, info.channels, scale)
    return MapInfo(f"{info.label}, relative", "1", info.channels, 1.0)
