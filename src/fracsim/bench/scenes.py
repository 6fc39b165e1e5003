"""Scenes that tear, small enough to be run dozens of times, and what is compared between their runs."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from fracsim import backend
from fracsim.asset.build import build
from fracsim.records import Array
from fracsim.render.film import Film
from fracsim.scene.program import compose
from fracsim.scene.vocab import Scene
from fracsim.solve.march import SimulationError
from fracsim.solve.simulator import Simulator

HALF = ("asset.size=0.3", "loading.offset=0.1", "loading.thickness=0.04", "capture.fps=300", "camera.width=128",
        "camera.height=128", "capture.rgb=false", "capture.maps=[stress,damage]", "backend.threads=1")  # fmt: skip
"""Objects of half the usual size, so that 150 cells make an eighth of the usual particles."""
SCENES = {
    "low stretch": (*HALF, "asset=bread", "loading.speed=0.4", "capture.frames=80"),
    "high stretch": (*HALF, "asset=duck", "material=rubber", "loading.speed=0.6", "capture.frames=70"),
}


@dataclass(frozen=True)
class Outcome:
    """What one run of a scene gave."""

    seconds: float
    """Processor time of the simulation, object and kernels prepared."""
    substeps: int
    break_time: float
    """When the load has fallen to half of its peak [s]; NaN when it has not."""
    peak: float
    """Largest load [N], not counting the blow with which the grips start."""
    failed: float
    """Fraction of failed particles at the end."""
    maps: Array
    """Stress and damage maps of all frames, each over its own largest value in the reference, (T, H, W, 2)."""

    def against(self, true: "Outcome") -> dict[str, float]:
        """Relative errors of break time and peak load, absolute ones of the failed fraction and of the maps (mean over
        the pixels that show the object in either run)."""
        scale = np.maximum(true.maps.max(axis=(0, 1, 2)), 1e-12)
        difference = np.abs(self.maps - true.maps) / scale
        seen = (self.maps != 0) | (true.maps != 0)
        return {
            "break_time": abs(self.break_time / true.break_time - 1),
            "peak_load": abs(self.peak / true.peak - 1),
            "failed": abs(self.failed - true.failed),
            "maps": float(difference[seen].mean()),
        }


def run(scene: Scene) -> Outcome:
    """Run and film a scene; a run that fails is compared up to its failure (its break time is NaN then)."""
    backend.start(scene.backend)
    particles = build(scene.asset, scene.solver.spacing, scene.seed)
    next(Simulator(scene, particles).frames())
    compile_kernels(scene, particles)
    simulator, film = Simulator(scene, particles), Film(scene)
    frames, spent, pictures = simulator.frames(), 0.0, []
    while True:
        start = time.process_time()
        try:
            frame = next(frames, None)
        except SimulationError:
            frame = None
        spent += time.process_time() - start
        if frame is None:
            break
        maps = film.shoot(frame, simulator.particles).maps
        pictures.append(np.concatenate([maps["stress"], maps["damage"]], axis=2).astype(np.float32))
    pictures += [pictures[-1]] * (scene.capture.frames - len(pictures))
    h = simulator.report.history
    broken, peak = broken_at(np.array(h.t), np.array(h.load))
    return Outcome(spent, simulator.report.substeps, broken, peak, h.failed[-1], np.array(pictures))


def compile_kernels(scene: Scene, particles: Any) -> None:
    """Two frames of the same scene, so that nothing is compiled while it is timed."""
    for frame in Simulator(scene, particles).frames():
        if frame.index == 1:
            return


def broken_at(t: Array, load: Array) -> tuple[float, float]:
    """When the load falls through half of its peak [s], linear between frames, NaN when it does not; and the peak [N].

    The first tenth of the frames does not count: the grips start with a blow, whose load may be larger.
    """
    start = len(load) // 10
    peak = start + int(load[start:].argmax())
    below = np.flatnonzero(load[peak:] < load[peak] / 2)
    if not len(below):
        return float("nan"), float(load[peak])
    k = peak + int(below[0])
    return float(np.interp(load[peak] / 2, load[[k, k - 1]], t[[k, k - 1]])), float(load[peak])


def scene(name: str, *overrides: str) -> Scene:
    """One of SCENES with overrides."""
    return compose(*SCENES[name], *overrides)
