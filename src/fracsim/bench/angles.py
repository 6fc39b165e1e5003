"""The same bar at other angles and places between the nodes of the grid: it must break at the same stretch and load.

Each bar lies along the tearing axis. Those of `solver.lattice=world`, whose sides lie across the grid, are for
comparison. Peaks and roughness are those before the bar parts.
"""

import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fracsim import backend
from fracsim.asset.build import build_of
from fracsim.asset.place import rotation
from fracsim.bench.record import Row
from fracsim.records import Particles
from fracsim.scene.program import compose
from fracsim.scene.vocab import CENTRE, Backend, Scene
from fracsim.solve.simulator import Simulator
from fracsim.verify.closed_form import softening

EDGES = (0.6, 0.1, 0.1)
"""Edges of the bar [m]: seven and a half cells across."""
SECTION = EDGES[1] * EDGES[2]
"""[m^2]"""
CLASSES = {"high stretch": "material=rubber", "low stretch": "material=bread"}
ANGLES = tuple(7.5 * k for k in range(24))
"""Tearing axes [deg]."""
PLACES = ((0, 0.25, 0.25), (0, 0.5, 0.5), (0, 0.1, 0.3), (0.25, 0, 0), (0.5, 0, 0), (0.75, 0, 0), (0.3, 0.2, 0.4))
"""Offsets of an aligned bar from the grid and the grips [cells]."""
OBLIQUE = (7.5, 15.0, 30.0, 45.0)
"""Tearing axes of the bars on a lattice along the world's axes [deg]."""
FRAMES, BEYOND = 300, 1.12
"""Frames until the bar is pulled to this many times the stretch of the closed form."""
LOOK, MIDDLE = 0.8, 3.0
"""Roughness is that at this part of the elongation at break, within this many cells of the middle."""
LIMITS = {"default": (0.015, 0.02, 2.0), "preview": (0.03, 0.03, None)}
"""Of each quality: most deviation of break stretch and of peak load, and most roughness, from the aligned bar."""


class Pull(NamedTuple):
    """What is measured of a bar."""

    stretch: float
    """Nominal stretch at the break."""
    peak: float
    """Largest nominal stress [Pa], without the initial blow of the grips."""
    rough: float
    """Standard deviation of the skin's stretch along the axis over its mean."""
    seconds: float
    """Processor time."""


def bar_scene(folder: Path, material: str, quality: str, axis_deg: float, lattice: str = "axis") -> Scene:
    """The bar, turned with the tearing axis, as a mesh in `folder`."""
    import trimesh

    mesh = trimesh.creation.box(EDGES)
    turn = np.eye(4)
    turn[:3, :3] = rotation([0.0, 0.0, axis_deg])
    mesh.apply_transform(turn)
    path = folder / f"bar_{axis_deg:g}.obj"
    mesh.export(path)
    size = float(np.ptp(mesh.vertices, axis=0).max())
    overrides = ("asset=mesh", f"asset.path='{path}'", f"asset.size={size}", material, f"quality={quality}",
                 "loading.grips=sliding", f"loading.axis_deg={axis_deg}", f"solver.lattice={lattice}",
                 "backend.threads=1")  # fmt: skip
    scene = compose(*overrides)
    load = scene.loading
    duration = (_closed_form(scene)[0] * BEYOND - 1) * load.gauge / (2 * load.speed)
    return replace(scene, capture=replace(scene.capture, frames=FRAMES, fps=(FRAMES - 1) / duration))


def _closed_form(scene: Scene) -> tuple[float, float]:
    """Break stretch and peak stress [Pa] of a uniform bar that is pulled slowly."""
    material, fracture = scene.material, scene.fracture
    stretch, load, _ = softening(material.law, material.nu, fracture.onset, fracture.crit)
    return stretch, load * material.E


def pull(scene: Scene, body: Particles) -> Pull:
    """Pull a bar until it parts."""
    start = time.process_time()
    simulator, axis = Simulator(scene, body), np.asarray(scene.loading.axis)
    along = np.abs((simulator.particles.X - np.asarray(CENTRE)) @ axis)
    skin = simulator.particles.surface & (along < MIDDLE * scene.solver.h)
    look, rough = 1 + LOOK * (_closed_form(scene)[0] - 1), float("nan")
    history = simulator.report.history
    for frame in simulator.frames():
        if np.isnan(rough) and history.nominal_stretch[-1] >= look:
            stretch = np.linalg.norm(frame.F[skin] @ axis, axis=1)
            rough = float(stretch.std() / stretch.mean())
        if simulator.report.parted:
            break
    at = simulator.report.break_frame
    parted = float("nan") if at is None else history.nominal_stretch[at]
    load = np.array(history.load)
    return Pull(parted, float(load[len(load) // 5 :].max()) / SECTION, rough, time.process_time() - start)


def shifted(body: Particles, cells: tuple[float, float, float], h: float) -> Particles:
    """A body moved by `cells` cells of h [m] along x, y and z."""
    return replace(body, X=(body.X + h * np.array(cells)).astype(np.float32))


def pulls(folder: Path, material: str, quality: str, quick: bool) -> Iterator[tuple[str, str, Pull]]:
    """Kind, name and measurements of all bars of a class; the first one is the aligned bar in the middle."""
    for angle in OBLIQUE[:2] if quick else ANGLES:
        scene = bar_scene(folder, material, quality, 0.0 if quick and angle == OBLIQUE[0] else angle)
        yield "angle", f"{scene.loading.axis_deg:g} deg", pull(scene, build_of(scene))
    scene = bar_scene(folder, material, quality, 0.0)
    body = build_of(scene)
    for cells in PLACES[-1:] if quick else PLACES:
        name = "moved by " + ", ".join(f"{c:g}" for c in cells) + " cells"
        yield "place", name, pull(scene, shifted(body, cells, scene.solver.h))
    for angle in OBLIQUE[1:2] if quick else OBLIQUE:
        scene = bar_scene(folder, material, quality, angle, "world")
        yield "lattice=world", f"{angle:g} deg", pull(scene, build_of(scene))


def study(out: Path, quick: bool) -> Iterator[Row]:
    """Bars of both classes at all angles and places, against the aligned bar in the middle."""
    backend.start(Backend(threads=1))
    with tempfile.TemporaryDirectory() as folder:
        for name, material in CLASSES.items():
            for quality in ("preview",) if quick else ("default", "preview"):
                yield from _rows(Path(folder), name, material, quality, quick)


def _rows(folder: Path, name: str, material: str, quality: str, quick: bool) -> Iterator[Row]:
    """The rows of one class and quality: every bar, then the worst of each kind."""
    title = f"{name}, {quality}"
    found: dict[str, list[Pull]] = {}
    exact = _closed_form(bar_scene(folder, material, quality, 0.0))
    first = None
    for kind, what, one in pulls(folder, material, quality, quick):
        if first is None:
            first = one
            yield Row(title, "aligned: break stretch over the closed form", one.stretch / exact[0], "1")
            yield Row(title, "aligned: peak load over the closed form", one.peak / exact[1], "1")
            yield Row(title, "aligned: roughness of the skin's stretch", 100 * one.rough, "%")
        ratio = Pull(one.stretch / first.stretch, one.peak / first.peak, one.rough / first.rough, one.seconds)
        found.setdefault(kind, []).append(ratio)
        for label, value in zip(("break stretch", "peak load", "roughness"), ratio[:3], strict=True):
            yield Row(title, f"{kind} {what}: {label} over that of the aligned bar", value, "1")
    for kind, ratios in found.items():
        stretch, peak, rough, seconds = np.array(ratios).T
        most = LIMITS[quality] if kind != "lattice=world" else (None, None, None)
        yield Row(title, f"{kind}: worst break stretch", float(np.abs(stretch - 1).max()), "1", most=most[0])
        yield Row(title, f"{kind}: worst peak load", float(np.abs(peak - 1).max()), "1", most=most[1])
        yield Row(title, f"{kind}: worst roughness", float(rough.max()), "1", most=most[2])
        yield Row(title, f"{kind}: median processor time of a pull", float(np.median(seconds)), "s")
