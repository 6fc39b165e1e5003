"""What the study varies and how large it is, and where each of its parts lies."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from fracsim.scene.classes import TEST, TRAIN

STAGES = (1, 2, 3)
METRICS = ("psnr", "ssim", "stlpips", "lpips", "fvd", "kvd", "sac", "dpa", "r2_cons", "map_mse", "iou")
"""Metrics of the ablation."""
OF_SETS = ("fvd", "kvd")
"""Of these, distances of sets of clips, which say nothing of a few."""
WIDTH, FRAMES = 96, 21
"""Pictures of conf/sweep/laptop.yaml: width and height [px], and their number."""
SIMULATORS = {
    "laptop": (),
    "preview": ("solver.cells=100",),
    "default": ("solver.cells=150", "solver.particles_per_axis=2"),
    "reference": ("solver.cells=150", "solver.particles_per_axis=2", "solver.precision=float64", "solver.safety=0.4"),
}
"""Solvers that are compared with the generator, by what they change in conf/sweep/laptop.yaml."""
PRESETS = ("preview", "default")
"""Samplers that are compared with them, files of conf/sampler."""
ANGLES = (0, 45, 90, 135)
"""Axes of the controlled pulls [deg]."""
THRESHOLDS = {"early": "bread", "late": "rubber_late"}
"""Thresholds of the controlled pulls, files of conf/fracture."""
SHOWN_OBJECTS = ("bread", "star")
"""Held-out objects, one of each class, of the controlled pulls."""


class Variant(NamedTuple):
    """One training of the ablation."""

    name: str
    stage: int
    seed: int

    @property
    def run(self) -> str:
        """The parent of its run, below the folder of the study."""
        return f"runs/seed{self.seed}{'' if self.name.startswith('stage') else f'-{self.name}'}"

    @property
    def place(self) -> str:
        """Its own folder among samples and scores."""
        return f"seed{self.seed}/{self.name}"


@dataclass(frozen=True)
class Study:
    """How large it is; the defaults are those of `make laptop`."""

    folder: Path = Path("outputs/laptop")
    seeds: int = 2
    steps: int = 500
    """Optimiser steps of each stage; those of conf/experiment/laptop.yaml."""
    train_objects: tuple[str, ...] = TRAIN
    test_objects: tuple[str, ...] = TEST
    train_draws: int = 36
    """Rows of the parameter table for each object to train on, from row 0."""
    test_draws: int = 10
    """Rows for each held-out object, behind those."""
    compared_draws: int = 1
    """Of these, rows that are simulated with other solvers too."""
    vae_steps: int = 400
    vae_clips: int = 48
    angles: tuple[int, ...] = ANGLES
    solvers: tuple[str, ...] = tuple(SIMULATORS)
    """Entries of SIMULATORS; the last one is the truth of the comparison."""
    least: int = 160
    """Clips without which the study does not go on: a few pulls fail on so coarse a grid."""

    def path(self, *parts: str) -> str:
        """A path below the folder of the study."""
        return self.folder.joinpath(*parts).as_posix()

    @property
    def variants(self) -> Iterator[Variant]:
        """All trainings, stage by stage, the control last: stage 3 with lambda_const = 0."""
        for stage in STAGES:
            yield from (Variant(f"stage{stage}", stage, seed) for seed in range(self.seeds))
        yield from (Variant("control", 3, seed) for seed in range(self.seeds))

    def run(self, variant: Variant) -> str:
        """The folder of a run, whose name has a hash: a pattern that fits one folder."""
        return self.path(variant.run, f"stage{variant.stage}-*")


FULL = Study()
QUICK = Study(
    folder=Path("outputs/laptop_quick"),
    seeds=1,
    steps=20,
    train_objects=("muffin", "duck"),
    test_objects=("bread", "star"),
    train_draws=2,
    test_draws=2,
    vae_steps=20,
    vae_clips=8,
    angles=(0,),
    solvers=("laptop", "preview"),
    least=4,
)
"""Eight clips and short trainings, to see in minutes whether everything runs; its figures mean nothing."""
