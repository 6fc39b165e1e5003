"""Videos of clips of the validation: what the network makes of them beside the truth.

    force           | predicted colour | true colour
    predicted flow  | strain | stress  | damage
    true flow       | strain | stress  | damage

A stage without maps has the first row only.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from lightning import Trainer
from lightning.pytorch.loggers import WandbLogger

from fracgen.evaluation.clip import Pair
from fracgen.layout import MAPS, RGB
from fracgen.training.decoded import picture
from fracsim.records import Array
from fracsim.sample.video import Encoder

LUMA = (0.2126, 0.7152, 0.0722)
"""Weights of red, green and blue in luminance (Rec. 709)."""


def write(pair: Pair, force: Array, file: Path) -> None:
    """Write the video of a clip; `force` are the blobs of its loading, (F, h, w, 3) bytes."""
    pictures = {"force": force}
    for kind, clip in (("predicted", pair.pred), ("true", pair.true)):
        pictures |= {f"{kind} {name}": picture(clip, name) for name in clip.loads}
    frames = arrange(pictures, tuple(pair.pred.loads))
    with Encoder(file, frames.shape[2], frames.shape[1], "strip") as encoder:
        for frame in frames:
            encoder.write(frame)


def arrange(pictures: Mapping[str, Array], streams: tuple[str, ...]) -> Array:
    """The frames of a mosaic, (F, rows h, columns w, 3), of videos (F, h, w, 3); tiles without a video are black."""
    rows = [["force", f"predicted {RGB}", f"true {RGB}"]]
    if len(streams) > 1:
        rows += [[f"{kind} {name}" for name in MAPS] for kind in ("predicted", "true")]
    columns = max(len(row) for row in rows)
    black = np.zeros_like(pictures["force"])
    tiles = [[pictures.get(name, black) for name in [*row, *[""] * (columns - len(row))]] for row in rows]
    return np.concatenate([np.concatenate(row, axis=2) for row in tiles], axis=1)


def luminance_jump(video: Array) -> float:
    """Change of the mean luminance, in [0, 1], from frame 0 to frame 1 of a video (F, h, w, 3) of bytes; 0 for one
    frame. A faulty first frame shows here."""
    first = video[:2].mean(axis=(1, 2)) @ np.array(LUMA) / 255
    return float(abs(first[-1] - first[0]))


def show(trainer: Trainer, place: Path) -> None:
    """Hand the videos of a folder to wandb, if that is a logger."""
    for logger in trainer.loggers:
        if isinstance(logger, WandbLogger):
            for file in sorted(place.glob("*.mp4")):
                logger.log_video(f"video/{file.stem}", [str(file)], format=["mp4"])
