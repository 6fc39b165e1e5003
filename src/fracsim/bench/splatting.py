"""The rasteriser: colour with four maps against colour alone, on an opaque solid that fills the image.

Times depend on what else the machine does. So a picture is also given as processor time over that of a yardstick, a
million numbers sorted by NumPy on one thread in the same round, with the share of a processor that the yardstick got: 1
on an idle machine.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from fracsim import backend
from fracsim.bench.plan import Plan
from fracsim.bench.record import Row, median
from fracsim.bench.worker import Worker, serve
from fracsim.records import Array, Frame, Particles
from fracsim.scene.vocab import CENTRE, Backend, Camera, Scene

FRAME = 0.12
"""Target of a frame with maps [s]."""
SHARE = 1.4
"""Target of the time of a frame with maps over that of one with colour alone."""
AXES = (0.3, 0.2, 0.2)
"""Half axes of the solid [m]."""
YARDSTICK = 1_000_000
"""Numbers that the yardstick sorts."""
MARGIN = 1.05
"""Half width of the view over that of the solid."""


def rows(plan: Plan) -> Iterator[Row]:
    """Measure with all cores."""
    with Worker("splatting", plan.gaussians, plan.pixels) as worker:
        rounds = [worker.measure() for _ in range(plan.rounds)]
    what = f"picture, {plan.gaussians:,} Gaussians, {plan.pixels} x {plan.pixels}"
    seconds = {name: [float(r[name]) for r in rounds] for name in rounds[0]}
    yield median(what, "RGB", seconds["rgb"], "s")
    yield median(what, "RGB + 4 maps", seconds["maps"], "s", most=FRAME)
    yield median(what, "RGB + 4 maps / RGB", _ratios(seconds["maps"], seconds["rgb"]), "times", most=SHARE)
    yield median(what, "RGB + 4 maps, their quantities and RGB as bytes included", seconds["film"], "s")
    yield median(what, f"yardstick: {YARDSTICK:,} float32 sorted by NumPy, one thread", seconds["yardstick"], "s")
    share = statistics.median(_ratios(seconds["yardstick, processor"], seconds["yardstick"]))
    yield Row(what, "share of a processor that the yardstick got", share, "1")
    for name, label in (("rgb", "RGB"), ("maps", "RGB + 4 maps")):
        ratios = _ratios(seconds[f"{name}, processor"], seconds["yardstick, processor"])
        yield median(what, f"{label} / yardstick, processor time", ratios, "times")


def _ratios(some: Sequence[float], others: Sequence[float]) -> list[float]:
    """Quotients of times of the same rounds."""
    return [a / b for a, b in zip(some, others, strict=True)]


def solid(n: int) -> tuple[Particles, Frame]:
    """An ellipsoid of n round Gaussians on a lattice, slightly stretched and sheared."""
    volume = 4 / 3 * np.pi * np.prod(AXES)
    spacing = float((volume / n) ** (1 / 3))
    lattice = [spacing * np.arange(-int(1.1 * a / spacing), int(1.1 * a / spacing) + 1) for a in AXES]
    P = np.stack(np.meshgrid(*lattice, indexing="ij"), -1).reshape(-1, 3)
    P = P[np.argsort(np.linalg.norm(P / AXES, axis=1), kind="stable")[:n]].astype(np.float32)
    particles = Particles(
        X=(P + CENTRE).astype(np.float32),
        volume=np.full(n, spacing**3, np.float32),
        covariance=np.tile(np.array([1, 0, 0, 1, 0, 1], np.float32) * np.float32(0.36 * spacing**2), (n, 1)),
        opacity=np.full(n, 0.98, np.float32),
        sh=np.repeat((P / AXES)[:, None, :], 1, axis=1).astype(np.float32),
        surface=np.zeros(n, bool),
        spacing=spacing,
    )
    F = np.tile(np.eye(3, dtype=np.float32), (n, 1, 1))
    F[:, 0, 0], F[:, 0, 1] = 1.1, P[:, 0]
    tau = np.float32(1e3) * (F - np.eye(3, dtype=np.float32))
    frame = Frame(1, 0.01, particles.X, P.copy(), F, tau, np.clip(5 * P[:, 0], 0, 1))
    return particles, frame


def timed(work: Callable[[], object]) -> float:
    """Seconds of one call, after a first one that wakes the threads."""
    work()
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def measured(works: Mapping[str, Callable[[], object]]) -> dict[str, float]:
    """Seconds of one call each, and of processor time of all threads in another one."""
    out = {name: timed(work) for name, work in works.items()}
    for name, work in works.items():
        start = time.process_time()
        work()
        out[f"{name}, processor"] = time.process_time() - start
    return out


def yardstick() -> dict[str, float]:
    """Seconds of the yardstick, and the processor time that it got in them."""
    values = np.random.default_rng(0).random(YARDSTICK, dtype=np.float32)
    wall, own = time.perf_counter(), time.thread_time()
    np.sort(values)
    return {"yardstick, processor": time.thread_time() - own, "yardstick": time.perf_counter() - wall}


def contestants(n: int, pixels: int) -> dict[str, Callable[[], object]]:
    """The functions to time for n Gaussians, each called once to compile it; starts Taichi."""
    backend.start(Backend())
    from fracsim.render.film import Film
    from fracsim.render.splat import Splatter

    film = Film(Scene(camera=Camera(width=pixels, height=pixels, half_width=MARGIN * AXES[0])))
    particles, frame = solid(n)

    def splat(splatter: Splatter, features: Array) -> Callable[[], object]:
        """A function that renders features (n, C)."""
        return lambda: splatter.render(frame.x, particles.covariance, frame.F, particles.opacity, features)

    features = np.random.default_rng(0).random((n, film.channels), dtype=np.float32)
    out: dict[str, Callable[[], object]] = {
        "rgb": splat(Splatter(film.view, 3), np.ascontiguousarray(features[:, :3])),
        "maps": splat(Splatter(film.view, film.channels), features),
        "film": lambda: film.shoot(frame, particles),
    }
    for work in out.values():
        work()
    return out


def main() -> None:
    """The process that renders: compile, then time one frame of each kind at each `go`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("gaussians", type=int)
    parser.add_argument("pixels", type=int)
    options = parser.parse_args()
    works = contestants(options.gaussians, options.pixels)
    serve(lambda: measured(works) | yardstick())


if __name__ == "__main__":
    main()
