"""What Gaussians behind opaque ones cost: a picture of all, and one of those alone that show in some pixel.

Which ones show is known only once all are composited, so that the difference bounds what any culling can save.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from fracsim.bench.record import Row
from fracsim.bench.shown import composite
from fracsim.records import Array, Frame, Particles
from fracsim.render.film import Film, Picture
from fracsim.scene.vocab import Scene
from fracsim.solve.simulator import Simulator

PHASES = {8: "unbroken", 16: "tearing", 40: "broken"}
"""Frames of the default loaf, which parts at frame 18."""
REPEATS = 15


def showing(film: Film, n: int) -> Array:
    """Whether each of the n Gaussians of the picture shot last takes light from some pixel, (n,)."""
    splatter = film.splatter
    assert splatter is not None
    shows = np.zeros(n, np.int32)
    transmittance = np.ones((film.view.height, film.view.width), np.float32)
    composite(*splatter.tile_lists(), transmittance, shows)
    return shows > 0


def part(record: Any, mask: Array) -> Any:
    """Those rows of all arrays of a frame or of particles."""
    return replace(record, **{name: a[mask] for name, a in vars(record).items() if isinstance(a, np.ndarray)})


def same(one: Picture, other: Picture) -> bool:
    """Whether two pictures are equal bit for bit."""
    layers = [{**vars(picture), **picture.maps} for picture in (one, other)]
    return all(np.array_equal(layers[0][name], layers[1][name]) for name in layers[0] if name != "maps")


def seconds(film: Film, shots: dict[str, tuple[Frame, Particles]]) -> dict[str, float]:
    """Median processor time of each picture [s], taken in turns."""
    spent: dict[str, list[float]] = {name: [] for name in shots}
    for _ in range(REPEATS):
        for name, shot in shots.items():
            start = time.process_time()
            film.shoot(*shot)
            spent[name].append(time.process_time() - start)
    return {name: float(np.median(values)) for name, values in spent.items()}


def rows(scene: Scene, body: Particles) -> Iterator[Row]:
    """Unbroken, tearing and broken, and what a perfect culling that costs nothing would save of a clip."""
    simulator, film = Simulator(scene, body), Film(scene)
    start, paused = time.process_time(), 0.0
    for frame in simulator.frames():
        if frame.index not in PHASES:
            continue
        stop = time.process_time()
        particles = simulator.particles
        whole = film.shoot(frame, particles)
        shows = showing(film, len(particles))
        few = part(frame, shows), part(particles, shows)
        assert same(whole, film.shoot(*few)), "a Gaussian that shows was left out"
        spent = seconds(film, {"all": (frame, particles), "those that show": few})
        paused += time.process_time() - stop
        what = f"hidden Gaussians, {PHASES[frame.index]} (not skipped, see docs)"
        yield Row(what, "Gaussians that show, part of all", float(shows.mean()), "1")
        for name, value in spent.items():
            yield Row(what, f"picture of {name}", value, "s/frame")
        if frame.index == max(PHASES):
            motion = (time.process_time() - start - paused) / frame.index
            gain = (spent["all"] - spent["those that show"]) / (motion + spent["all"])
            yield Row(what, "saved at most, part of simulating and filming", gain, "1")
            return
