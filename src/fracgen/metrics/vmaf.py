"""VMAF (model v0.6.1), a perceptual quality of compressed video, by the ffmpeg of imageio-ffmpeg; higher is better.

From 0 to about 100; equal clips score a little below 100. For codecs and renderers, not for generation: an object that
is off by a few pixels scores 0.
"""

import json
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from imageio_ffmpeg import get_ffmpeg_exe

from fracgen.evaluation.per_frame import PerFrame
from fracsim.records import Array
from fracsim.scene.knob import check, knob

MODEL = "vmaf_v0.6.1"
LOG = "vmaf.json"
LEAST_SIZE = 32
"""Least height and width [px]; at 16 the filter ends in a fault."""


@dataclass(kw_only=True)
class Settings:
    """How it is run."""

    threads: int = knob(1, "threads of ffmpeg's filter", least=1, most=256)

    def __post_init__(self) -> None:
        check(self, "metric.vmaf")


class Vmaf(PerFrame):
    """See above."""

    name, better = "vmaf", True

    def __init__(self, threads: int) -> None:
        super().__init__()
        self.threads = threads

    def scores(self, pred: Array, true: Array) -> Array:
        """The score of each frame of two videos (T, H, W, 3) uint8, (T,).

        Raises ValueError for pictures that are smaller than 32 px, and OSError when ffmpeg fails.
        """
        height, width = pred.shape[1:3]
        if min(height, width) < LEAST_SIZE:
            raise ValueError(f"vmaf: pictures of {width} x {height} px are too small, {LEAST_SIZE} x {LEAST_SIZE} are "
                             "needed: make larger ones, or leave metric vmaf out.")  # fmt: skip
        with tempfile.TemporaryDirectory() as folder:
            command = _command(width, height, self.threads)
            both = np.concatenate([pred, true], axis=1)  # one above the other, so that one pipe is enough
            done = subprocess.run(command, input=both.tobytes(), capture_output=True, cwd=folder)
            log = Path(folder, LOG)
            if done.returncode or not log.is_file():
                reason = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
                raise OSError(f"vmaf: ffmpeg ended with status {done.returncode}: {reason or 'no message'}")
            frames = json.loads(log.read_text())["frames"]
        return np.array([frame["metrics"]["vmaf"] for frame in frames])

    def about(self) -> dict[str, Any]:
        """The model and the ffmpeg."""
        return {"model": MODEL, "ffmpeg": Path(get_ffmpeg_exe()).name}


def _command(width: int, height: int, threads: int) -> list[str]:
    """ffmpeg that compares the upper half of each frame on its standard input with the lower one, and writes LOG."""
    crop = f"crop={width}:{height}:0"
    compare = f"libvmaf=model=version={MODEL}:n_threads={threads}:log_fmt=json:log_path={LOG}"
    graph = f"split[a][b];[a]{crop}:0,format=yuv444p[p];[b]{crop}:{height},format=yuv444p[t];[p][t]{compare}"
    return [get_ffmpeg_exe(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{2 * height}",
            "-i", "-", "-lavfi", graph, "-f", "null", "-"]  # fmt: skip


def build(settings: Settings) -> Vmaf:
    """The metric; raises ValueError where ffmpeg has no filter for it."""
    filters = subprocess.run([get_ffmpeg_exe(), "-v", "error", "-filters"], capture_output=True, text=True)
    if " libvmaf " not in filters.stdout:
        raise ValueError(f"metric=vmaf: {get_ffmpeg_exe()} has no filter libvmaf: unset IMAGEIO_FFMPEG_EXE, to use "
                         "that of imageio-ffmpeg, or leave metric vmaf out.")  # fmt: skip
    return Vmaf(settings.threads)
