"""The cost of hidden Gaussians: times of an image of all Gaussians, and of one of the visible ones alone.

A Gaussian is visible if it contributes to a pixel. This is known only after compositing all, so the difference of the
times is an upper bound of what any culling can save.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from fracsim.bench.record import Row
from fracsim.bench.visible import mark_visible
from fracsim.records import Array, Frame, Particles
from fracsim.render.film import Film, Picture
from fracsim.scene.vocab import Scene
from fracsim.solve.simulator import Simulator

PHASES = {8: "unbroken", 16: "tearing", 40: "broken"}
"""Frames of the default loaf; it parts at frame 18."""
REPEATS = 15


def visible(film: Film, n: int) -> Array:
    """Whether each of the n Gaussians contributes to the film's last image, (n,) bool."""
    splatter = film.splatter
    assert splatter is not None
    marks = np.zeros(n, np.int32)
    transmittance = np.ones((film.view.height, film.view.width), np.float32)
    mark_visible(*splatter.tile_lists(), transmittance, marks)
    return marks > 0


def select(record: Any, mask: Array) -> Any:
    """A frame or particles with the rows `mask`, (N,) bool, of all arrays."""
    return replace(record, **{name: a[mask] for name, a in vars(record).items() if isinstance(a, np.ndarray)})


def equal(one: Picture, other: Picture) -> bool:
    """Whether two pictures are equal bit for bit."""
    layers = [{**vars(picture), **picture.maps} for picture in (one, other)]
    return all(np.array_equal(layers[0][name], layers[1][name]) for name in layers[0] if name != "maps")


def seconds(film: Film, shots: dict[str, tuple[Frame, Particles]]) -> dict[str, float]:
    """Median processor time of each picture [s]; the pictures take turns."""
    spent: dict[str, list[float]] = {name: [] for name in shots}
    for _ in range(REPEATS):
        for name, shot in shots.items():
            start = time.process_time()
            film.shoot(*shot)
            spent[name].append(time.process_time() - start)
    return {name: float(np.median(values)) for name, values in spent.items()}


def rows(scene: Scene, body: Particles) -> Iterator[Row]:
    """Figures of an unbroken, a tearing and a broken object; the largest saving in a clip by a culling without cost."""
    simulator, film = Simulator(scene, body), Film(scene)
    start, paused = time.process_time(), 0.0
    for frame in simulator.frames():
        if frame.index not in PHASES:
            continue
        stop = time.process_time()
        particles = simulator.particles
        whole = film.shoot(frame, particles)
        mask = visible(film, len(particles))
        few = select(frame, mask), select(particles, mask)
        assert equal(whole, film.shoot(*few)), "a visible Gaussian was left out"
        spent = seconds(film, {"all": (frame, particles), "those that show": few})
        paused += time.process_time() - stop
        what = f"hidden Gaussians, {PHASES[frame.index]} (not skipped, see docs)"
        yield Row(what, "Gaussians that show, part of all", float(mask.mean()), "1")
        for name, value in spent.items():
            yield Row(what, f"picture of {name}", value, "s/frame")
        if frame.index == max(PHASES):
            motion = (time.process_time() - start - paused) / frame.index
            gain = (spent["all"] - spent["those that show"]) / (motion + spent["all"])
            yield Row(what, "saved at most, part of simulating and filming", gain, "1")
            return
