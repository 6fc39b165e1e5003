"""The gain from each computation that the code skips if a scene does not need it, and from skips that were rejected."""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti

from fracsim import backend
from fracsim.asset.build import build
from fracsim.bench import hidden
from fracsim.bench.record import Row
from fracsim.bench.tensors import by_invariants, by_svd, stretch_always, stretch_near_onset
from fracsim.lab.stage import lattice, particles
from fracsim.mpm.drive import Drive
from fracsim.mpm.state import State
from fracsim.render.film import Film
from fracsim.scene.program import compose
from fracsim.scene.vocab import Scene, Solver
from fracsim.solve import setup
from fracsim.solve.simulator import Simulator

SCENE = ("backend.threads=1", "capture.rgb=true")
STILL = 1e-3
"""Speed below which a particle counts as still, as part of the grips' speed."""


def seconds(work: Callable[[], Any], repeats: int = 5) -> float:
    """Median processor time [s] of `repeats` calls, after a first call that compiles."""
    work()
    spent = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        ti.sync()
        spent.append(time.process_time() - start)
    return float(np.median(spent))


def pair(what: str, unit: str, without: float, skipped: float) -> Iterator[Row]:
    """The figures without and with a skip, and their ratio."""
    yield Row(what, "always", without, unit)
    yield Row(what, "only where it is needed", skipped, unit)
    yield Row(what, "ratio", without / skipped, "times")


def tensors(n: int) -> Iterator[Row]:
    """Rotation and largest stretch of n random F; a tenth of them may exceed lambda_onset."""
    rng = np.random.default_rng(0)
    F = np.eye(3) + rng.normal(size=(n, 3, 3)) * np.where(rng.random(n) < 0.1, 0.4, 0.05)[:, None, None]
    values, out = F.astype(np.float32), np.zeros(n, np.float32)
    ns = {k.__name__: seconds(lambda k=k: k(values, out)) / n * 1e9  # type: ignore[misc]
          for k in (by_svd, by_invariants, stretch_always, stretch_near_onset)}  # fmt: skip
    yield from pair("R: an SVD", "ns/particle", ns["by_svd"], ns["by_invariants"])
    yield from pair("largest stretch", "ns/particle", ns["stretch_always"], ns["stretch_near_onset"])


def substeps(simulator: Simulator) -> Iterator[Row]:
    """Visited nodes, the survey for the stability bound, and failed particles."""
    state, scene = simulator.state, simulator.scene
    yield from pair("nodes a substep visits", "nodes", scene.solver.cells**3, len(state.grid.layout.nodes))
    one = seconds(lambda: state.run(16, 1e-5, 0.0)) / 16
    yield Row("look at the stability bound", "part of a round of 16 substeps",
              seconds(state.survey) / (16 * one), "1")  # fmt: skip
    failed = np.zeros(state.n)
    failed[: state.n // 3] = 1
    state.points.D.from_numpy(failed.astype(np.float32))
    yield from pair("a third of the particles failed", "s/substep", one, seconds(lambda: state.run(16, 1e-5, 0.0)) / 16)
    state.points.D.from_numpy(np.zeros(state.n, np.float32))


def launches() -> Iterator[Row]:
    """The cost of a substep of very few particles."""
    solver = Solver(cells=24)
    body = particles(lattice((0.4, 0.1, 0.1), solver.spacing), solver.spacing)
    for drive, threads, name in (
        ("threads", 2, "a launch a substep, two threads"),
        ("serial", 1, "one launch, one thread"),
    ):
        scene = Scene(solver=solver)
        state = State(setup.medium(scene), body, setup.grips(scene), Drive(drive, threads))
        spent = seconds(lambda state=state: state.run(400, 1e-5, 0.0)) / 400  # type: ignore[misc]
        yield Row(f"substep of {state.n} particles", name, 1e6 * spent, "us")


def pictures(simulator: Simulator) -> Iterator[Row]:
    """Rendering of all channels, or of one."""
    frame, particles = next(simulator.frames()), simulator.particles
    spent = {}
    for name, overrides in (("all", ()), ("damage", ("capture.rgb=false", "capture.maps=[damage]"))):
        film = Film(compose(*SCENE, *overrides))
        spent[name] = seconds(lambda film=film: film.shoot(frame, particles))  # type: ignore[misc]
    yield from pair("RGB and four maps, or damage alone", "s/frame", spent["all"], spent["damage"])


def objects() -> Iterator[Row]:
    """Preparation of an object for each draw of a sweep, or once."""
    scene = compose(*SCENE)
    before = os.environ.get("FRACSIM_CACHE")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["FRACSIM_CACHE"] = folder
        start = time.process_time()
        build(scene.asset, scene.solver.spacing, 0)
        first = time.process_time() - start
        again = seconds(lambda: build(scene.asset, scene.solver.spacing, 0), 2)
    os.environ.pop("FRACSIM_CACHE")
    if before is not None:
        os.environ["FRACSIM_CACHE"] = before
    yield from pair("object prepared", "s", first, again)


def settled(quick: bool) -> Iterator[Row]:
    """Substeps that `solver.until=settled` saves, and the share of still particles.

    Blocks of still particles could be skipped, but are not (see docs/speed.md).
    """
    common = ("quality=preview", "backend.threads=1", "asset=croissant", *(("capture.frames=4",) if quick else ()))
    counts, still, moving = {}, 0, 0
    for until in ("end", "settled"):
        scene = compose(*common, f"solver.until={until}")
        simulator = Simulator(scene, build(scene.asset, scene.solver.spacing, 0))
        for frame in simulator.frames():
            if until == "end":
                still += int((np.linalg.norm(frame.v, axis=1) < STILL * scene.loading.speed).sum())
                moving += len(frame.v)
        counts[until] = simulator.report.substeps
    yield from pair("substeps of the croissant, solver.until=settled", "substeps", counts["end"], counts["settled"])
    yield Row("particles at rest (blocks do not sleep)", "part of all, over all frames", still / moving, "1")


def study(out: Path, quick: bool) -> Iterator[Row]:
    """All skips, on the default loaf."""
    scene = compose(*SCENE, *(("solver.cells=40",) if quick else ()))
    backend.start(scene.backend)
    yield from tensors(2_000 if quick else 100_000)
    body = build(scene.asset, scene.solver.spacing, 0)
    yield from hidden.rows(scene, body)
    simulator = Simulator(scene, body)
    yield from pictures(simulator)
    yield from substeps(simulator)
    yield from launches()
    yield from objects()
    yield from settled(quick)
