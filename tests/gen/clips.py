"""Data sets of tiny clips for the tests of fracgen: simulated ones, and ones of random pictures made in no time."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from fracsim import Camera, Capture, Output, Scene, compose
from fracsim.run import pipeline
from fracsim.scene.vocab import Asset, Loading
from tests.command import SMALL
from tests.dataset import tiny

SCENES = (
    ("asset=croissant", "loading.speed=1"),
    ("asset=duck", "material=rubber", "fracture=rubber", "loading.speed=4"),
    ("asset=duck", "material=rubber", "fracture=rubber", "loading.speed=4", "material.E=8e3"),
    ("asset=star", "material=rubber", "loading.speed=4", "loading.axis_deg=90"),
)
"""Two clips that break and two that never do; the ducks differ in their stiffness only; the star is of split test."""


def tiny_clips(folder: Path, frames: int = 17) -> Path:
    """Simulate four clips of 64 x 64 pixels with all maps into `folder`; wants the fixture `taichi`, takes seconds."""
    for scene in SCENES:
        outcome = pipeline.run(compose(*SMALL, *scene, "capture.report=false", "capture.strip=false",
                                       f"capture.frames={frames}", f"output.folder={folder}"))  # fmt: skip
        assert outcome.status in ("complete", "never breaks"), outcome.reason
    return folder


def random_clips(folder: Path, objects: Sequence[str] = ("duck", "bear", "croissant", "star"), frames: int = 6,
                 speeds: Sequence[float] = (1.0, 2.0), maps: Sequence[str] = ("flow", "strain", "stress", "damage"),
                 size: tuple[int, int] = (32, 48), fps: float = 100.0) -> Path:  # fmt: skip
    """Write clips of random pictures, 32 x 48 pixels, one a combination of object and speed; no simulation."""
    assert frames <= tiny.FRAMES
    capture = Capture(frames=tiny.FRAMES, tracks=3, report=False, strip=False, maps=list(maps), fps=fps)
    output = Output(folder=str(folder), overwrite=True)
    for seed, (name, speed) in enumerate((name, speed) for speed in speeds for name in objects):
        scene = Scene(capture=capture, output=output, camera=Camera(width=size[0], height=size[1]),
                      asset=replace(Asset(), name=name), loading=replace(Loading(), speed=speed))  # fmt: skip
        tiny.record(scene, seed, broken=None)
    return folder


class FoldedVae:
    """Stands in for the VAE: means over 1 + 4 + 4 ... frames and 8 x 8 pixels, mixed to 16 channels; causal, exact."""

    identity = "folded"

    def __init__(self) -> None:
        self.mix = torch.randn(16, 3, generator=torch.Generator().manual_seed(0))
        self.encoded = 0

    def encode(self, video: Tensor) -> Tensor:
        assert video.dtype == torch.float32
        assert 0 <= video.min()
        assert video.max() <= 1
        self.encoded += len(video)
        first = video[:, :, :1].repeat(1, 1, 3, 1, 1)
        means = torch.nn.functional.avg_pool3d(torch.cat([first, video], dim=2), (4, 8, 8))
        return torch.einsum("oc,bcthw->bothw", self.mix, means)
