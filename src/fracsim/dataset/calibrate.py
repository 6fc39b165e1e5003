"""What clips cost on this machine, from a few short runs: seconds and bytes.

The model is seconds = a + substeps (b + c particles) + frames (d pixels + e particles). Three kinds of runs fit it:
for each constitutive law the cheapest scene on larger cells, which also tells how many more substeps a whole
pull takes than its state at rest would, and the first frames of a middle scene as it is. A further scene, on
cells twice as large, is only predicted: the error is that of its prediction. Bytes are those a frame and pixel of
the middle scene, and the other files of a small one. Preparing an object and compiling kernels, once each, is left
out; so is `solver.until=settled`, which ends a simulation early.
"""

import datetime
import json
import math
import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from fracsim.camera import view_of
from fracsim.dataset.breaks import breaking_frame, breaking_stretch
from fracsim.scene.vocab import Asset, Scene

COARSE = 40
"""Particles along the largest extent of an object whose volume is measured."""
SMALL, CHECK = 0.4, 0.5
"""Cells of the small scenes and of the predicted one, over those of the sweep."""
MIDDLE_FRAMES = 8
FEWEST_CELLS = 30
BUSY = 0.5
"""Cores in use by other processes from which a measurement is doubtful."""


@dataclass(frozen=True)
class Work:
    """What the cost of a clip follows from."""

    particles: int
    substeps: float
    """Predicted from the stability bound at rest, unless measured."""
    frames: int
    pixels: int


@dataclass(frozen=True)
class Cost:
    """What clips cost."""

    clip: float
    """a: seconds a clip."""
    substep: float
    """b: seconds a substep."""
    particle: float
    """c: seconds a particle and substep."""
    pixel: float
    """d: seconds a pixel and frame."""
    splat: float
    """e: seconds a particle and frame."""
    growth: dict[str, float]
    """Substeps of a whole pull over those that the state at rest asks for, by constitutive law."""
    video: float
    """Bytes a pixel and frame."""
    other: float
    """Bytes a clip beside video."""
    error: float
    """Predicted over measured seconds of the scene that did not fit the model, minus 1."""
    about: dict[str, Any] = field(default_factory=dict)
    """Machine, date, what was recorded, and what was predicted and measured."""

    def substeps(self, scene: Scene) -> float:
        """Substeps of a whole clip."""
        factor = self.growth.get(scene.material.law, max(self.growth.values(), default=1.0))
        return at_rest(scene) * (factor if isinstance(scene.solver.dt, str) else 1.0)

    def seconds(self, work: Work) -> float:
        """Wall-clock seconds of a clip."""
        return self.clip + sum(self.parts(work))

    def parts(self, work: Work) -> tuple[float, float]:
        """Seconds of simulation, and of rendering and writing."""
        simulate = work.substeps * (self.substep + self.particle * work.particles)
        return simulate, work.frames * (self.pixel * work.pixels + self.splat * work.particles)

    def of(self, scene: Scene) -> tuple[float, float]:
        """Seconds and bytes of the clip of a scene."""
        load = work(scene, self.substeps(scene))
        return self.seconds(load), self.other + self.video * load.frames * load.pixels


def work(scene: Scene, substeps: float) -> Work:
    """The work of a scene."""
    size = scene.camera.width * scene.camera.height if scene.capture.renders else 0
    return Work(particles(scene), substeps, scene.capture.frames, size)


def particles(scene: Scene) -> int:
    """About how many particles the object of a scene has."""
    from fracsim.asset.build import build

    if scene.asset.kind == "ply":  # has those of its file, whatever the spacing
        return len(build(scene.asset, scene.solver.spacing, 0).X)
    return round(_volume(json.dumps(asdict(scene.asset))) / scene.solver.spacing**3)


@lru_cache(maxsize=256)
def _volume(asset: str) -> float:
    """Volume of an object [m^3], given by the fields of its Asset as JSON."""
    from fracsim.asset.build import build

    given = Asset(**json.loads(asset))
    return float(build(given, given.size / COARSE, 0).volume.sum())


def at_rest(scene: Scene) -> float:
    """Substeps of a clip if the material stayed as it is at rest."""
    from fracsim.mpm.timestep import stable_at_rest
    from fracsim.solve.setup import medium

    s = scene.solver
    dt = s.safety * stable_at_rest(medium(scene)) if isinstance(s.dt, str) else float(s.dt)
    return (scene.capture.frames - 1) * math.ceil(1 / (scene.capture.fps * dt))


def stored() -> Cost:
    """The figures of the last calibration on this machine; raises ValueError when there are none."""
    from fracsim.asset import cache

    path = cache.folder() / "calibration.json"
    try:
        return Cost(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        raise ValueError(f"no calibration is stored in {path}: plan once without --no-calibrate.") from None


def calibrate(scenes: Sequence[Scene], say: Callable[[str], None]) -> Cost:
    """Run a few short scenes like those given, in a temporary folder, and store the figures.

    `say` is told what goes on. Raises RuntimeError when a run fails.
    """
    from fracsim.asset import cache

    busy = busy_cores()
    if busy > BUSY:
        say(f"other processes keep {busy:.1f} cores busy, so the hours will be too many: repeat when they have ended")
    small, middle, check = _choose(scenes)
    with tempfile.TemporaryDirectory() as folder:
        for scene in small:  # compiles the kernels and fills the object
            _measure(_shortened(scene, 2), folder, say, "warm-up")
        fitting = [_measure(scene, folder, say, "small") for scene in small]
        fitting.append(_measure(middle, folder, say, "middle"))
        cost = _fitted(fitting)
        checked = _measure(check, folder, say, "check")
    cost = _checked(cost, checked, fitting, scenes[0], busy)
    path = cache.folder() / "calibration.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(cost), indent=1) + "\n", encoding="utf-8")
    return cost


def busy_cores() -> float:
    """Cores that were busy during the last minute, as far as the system tells."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0


@dataclass(frozen=True)
class Measured:
    """One run."""

    name: str
    scene: Scene
    work: Work
    """With the particles and substeps that it had."""
    simulate: float
    """Seconds."""
    pictures: float
    """Seconds of rendering and writing."""
    wall: float
    """Seconds, without preparing the object."""
    video: int
    """Bytes of the videos."""
    other: int
    """Bytes of other files."""
    break_frame: int | None


def _choose(scenes: Sequence[Scene]) -> tuple[list[Scene], Scene, Scene]:
    """The cheapest scene of each law, reduced; a middle one, shortened; one to be predicted, reduced."""
    by_cost = sorted(scenes, key=lambda scene: at_rest(scene) * particles(scene))
    laws = dict.fromkeys(scene.material.law for scene in scenes)
    small = [next(s for s in by_cost if s.material.law == law) for law in laws]
    middle, check = by_cost[len(by_cost) // 2], by_cost[len(by_cost) // 3]
    return [_coarser(s, SMALL) for s in small], _shortened(middle, MIDDLE_FRAMES), _coarser(check, CHECK)


def _coarser(scene: Scene, factor: float) -> Scene:
    cells = max(min(FEWEST_CELLS, scene.solver.cells), round(scene.solver.cells * factor))
    return replace(scene, solver=replace(scene.solver, cells=cells))


def _shortened(scene: Scene, frames: int) -> Scene:
    """The first frames of a scene, seen as in the whole clip, where the object is small enough to have room to move."""
    view = view_of(scene)
    camera = replace(scene.camera, matrix=view.world_to_camera.ravel().tolist(),
                     intrinsics=[view.fx, view.fy, view.cx, view.cy])  # fmt: skip
    capture = replace(scene.capture, frames=min(frames, scene.capture.frames))
    return replace(scene, camera=camera, capture=capture)


def _measure(scene: Scene, folder: str, say: Callable[[str], None], name: str) -> Measured:
    """Run a scene; raises RuntimeError when it fails."""
    from fracsim.run.pipeline import run

    say(f"calibrating: {name}, {scene.asset.name}, {scene.solver.cells} cells, {scene.capture.frames} frames")
    begin = time.perf_counter()
    outcome = run(replace(scene, output=replace(scene.output, folder=folder, overwrite=True)))
    wall = time.perf_counter() - begin
    if not outcome.finished:
        raise RuntimeError(f"the calibration failed: {outcome.reason}")
    files = outcome.sample().meta["files"]
    video = sum(entry["bytes"] for file, entry in files.items() if file.endswith((".mkv", ".mp4")))
    report, spent = outcome.report, {"prepare": 0.0} | dict(outcome.seconds)
    load = replace(work(scene, report["substeps"]), particles=report["particles"])
    return Measured(
        name, scene, load,
        simulate=spent["simulate"], pictures=spent["render"] + spent["write"], wall=wall - spent["prepare"],
        video=video, other=sum(entry["bytes"] for entry in files.values()) - video, break_frame=report["break_frame"],
    )  # fmt: skip


def _fitted(runs: Sequence[Measured]) -> Cost:
    """The model that fits the runs best, in relative terms; no figure is negative."""
    substep, particle = _least([[m.work.substeps, m.work.substeps * m.work.particles] for m in runs],
                               [m.simulate for m in runs])  # fmt: skip
    pixel, splat = _least([[m.work.frames * m.work.pixels, m.work.frames * m.work.particles] for m in runs],
                          [m.pictures for m in runs])  # fmt: skip
    small, middle = runs[:-1], runs[-1]
    return Cost(
        clip=float(np.mean([max(m.wall - m.simulate - m.pictures, 0.0) for m in runs])),
        substep=substep, particle=particle, pixel=pixel, splat=splat,
        growth={m.scene.material.law: m.work.substeps / max(at_rest(m.scene), 1) for m in small},
        video=middle.video / max(middle.work.frames * middle.work.pixels, 1),
        other=float(np.mean([m.other for m in small])),
        error=math.nan,
    )  # fmt: skip


def _least(rows: list[list[float]], seconds: list[float]) -> tuple[float, float]:
    """The non-negative coefficients of the smallest relative squared error."""
    from scipy.optimize import nnls

    scale = np.maximum(seconds, 1e-9)[:, None]
    units = np.maximum(np.max(rows, axis=0), 1e-30)
    found, _ = nnls(np.array(rows) / units / scale, np.ones(len(rows)))
    first, second = (found / units).tolist()
    return first, second


def _checked(cost: Cost, run: Measured, fitting: Sequence[Measured], like: Scene, busy: float) -> Cost:
    """The figures with the error of the prediction of a run, and with what they were measured on."""
    from fracsim import backend
    from fracsim.sample.provenance import provenance

    predicted = cost.seconds(work(run.scene, cost.substeps(run.scene)))
    about: Mapping[str, Any] = {
        **provenance(),
        "date": datetime.date.today().isoformat(),
        "busy_cores": busy,
        "threads": backend.threads(like.backend),
        "recorded": [*(["rgb"] if like.capture.rgb else []), *like.capture.maps],
        "predicted_s": predicted,
        "measured_s": run.wall,
        "runs": [{"name": m.name, "object": m.scene.asset.name, "law": m.scene.material.law,
                  "cells": m.scene.solver.cells, "wall_s": m.wall, "break_frame": m.break_frame,
                  "predicted_frame": breaking_frame(m.scene, breaking_stretch(m.scene)), **asdict(m.work)}
                 for m in (*fitting, run)],
    }  # fmt: skip
    return replace(cost, error=predicted / run.wall - 1, about=dict(about))
