"""Small scenes that tear, and the figures compared between their runs."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from fracsim import backend
from fracsim.asset.build import build_of
from fracsim.records import Array
from fracsim.render.film import Film
from fracsim.scene.program import compose
from fracsim.scene.vocab import Scene
from fracsim.solve.march import SimulationError
from fracsim.solve.simulator import Simulator

HALF = ("asset.size=0.3", "loading.offset=0.1", "loading.thickness=0.04", "capture.fps=300", "camera.width=128",
        "camera.height=128", "capture.rgb=false", "capture.maps=[stress,damage]", "backend.threads=1")  # fmt: skip
"""Objects of half the usual size: on 150 cells they have an eighth of the usual particles."""
SCENES = {
    "low stretch": (*HALF, "asset=bread", "loading.speed=0.4", "capture.frames=80"),
    "high stretch": (*HALF, "asset=duck", "material=rubber", "loading.speed=0.6", "capture.frames=70"),
}


@dataclass(frozen=True)
class SceneRun:
    """The cost and the figures of one run of a scene."""

    seconds: float
    """Processor time of the simulation, without preparation of the object and compilation."""
    substeps: int
    break_time: float
    """Time at which the load has fallen to half of its peak [s]; NaN if it has not."""
    peak: float
    """Largest load [N], without the initial blow of the grips."""
    failed: float
    """Fraction of failed particles at the end."""
    maps: Array
    """Stress [Pa] and damage maps of all frames, (T, H, W, 2)."""

    def against(self, reference: "SceneRun") -> dict[str, float]:
        """Errors: relative for break time and peak load, absolute for the failed fraction and the maps.

        That of the maps is a mean over the pixels that show the object in either run.
        """
        scale = np.maximum(reference.maps.max(axis=(0, 1, 2)), 1e-12)
        difference = np.abs(self.maps - reference.maps) / scale
        seen = (self.maps != 0) | (reference.maps != 0)
        return {
            "break_time": abs(self.break_time / reference.break_time - 1),
            "peak_load": abs(self.peak / reference.peak - 1),
            "failed": abs(self.failed - reference.failed),
            "maps": float(difference[seen].mean()),
        }


def run(scene: Scene) -> SceneRun:
    """Run and film a scene. After an error the last picture stands for the missing frames."""
    backend.start(scene.backend)
    particles = build_of(scene)
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
    return SceneRun(spent, simulator.report.substeps, broken, peak, h.failed[-1], np.array(pictures))


def compile_kernels(scene: Scene, particles: Any) -> None:
    """Run two frames of a scene, so that all its kernels are compiled."""
    for frame in Simulator(scene, particles).frames():
        if frame.index == 1:
            return


def broken_at(t: Array, load: Array) -> tuple[float, float]:
    """Time [s] at which the load falls to half of its peak, and the peak [N], from t (T,) [s] and load (T,) [N].

    The load is linear between frames. The time is NaN if the load does not fall so far. The first tenth of the frames
    does not count: the initial blow of the grips may exceed the peak.
    """
    start = len(load) // 10
    peak = start + int(load[start:].argmax())
    below = np.flatnonzero(load[peak:] < load[peak] / 2)
    if not len(below):
        return float("nan"), float(load[peak])
    k = peak + int(below[0])
    return float(np.interp(load[peak] / 2, load[[k, k - 1]], t[[k, k - 1]])), float(load[peak])


def scene(name: str, *overrides: str) -> Scene:
    """A scene of SCENES with overrides."""
    return compose(*SCENES[name], *overrides)
