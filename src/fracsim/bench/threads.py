"""From how many particles on a second thread pays: `fracsim.mpm.drive:CHUNK`. Both drives take turns on one bar."""

import time
from collections.abc import Iterator
from pathlib import Path

from fracsim import backend
from fracsim.bench import bar
from fracsim.bench.record import Row, median
from fracsim.lab import stage
from fracsim.mpm.drive import CHUNK, Drive
from fracsim.mpm.state import State
from fracsim.scene.vocab import Backend, Scene, Solver
from fracsim.solve import setup

CELLS = {"total": (60, 80, 96, 110, 130), "updated": (40, 50, 60, 80)}
"""Cells along the domain, which set the number of particles of the bar."""
SUBSTEPS, ROUNDS = 64, 9
"""Substeps a measurement, and measurements of each drive."""


def study(out: Path, quick: bool) -> Iterator[Row]:
    """The time of a substep on one thread over that on two, for bars of more and more particles."""
    backend.start(Backend())
    for formulation, sizes in CELLS.items():
        for cells in sizes[:1] if quick else sizes:
            yield from rows(formulation, cells, 1 if quick else ROUNDS)


def rows(formulation: str, cells: int, rounds: int) -> Iterator[Row]:
    """One bar, whose domain has `cells` cells."""
    solver = Solver(cells=cells, formulation=formulation)
    scene = Scene(material=bar.material("fixed_corotated"), solver=solver)
    body = stage.bar(solver)
    states = [State(setup.medium(scene), body, setup.grips(scene), drive)
              for drive in (Drive("serial"), Drive("threads", 2))]  # fmt: skip
    for state in states:
        measure(state)  # compiles
    times = [[measure(state) for state in states] for _ in range(rounds)]
    what = f"{formulation}, {len(body):,} particles"
    for name, ns in zip(("1 thread", "2 threads"), zip(*times, strict=True), strict=True):
        yield median(what, name, list(ns), "ns/particle")
    least = 1.0 if len(body) > CHUNK[formulation] else None
    yield median(what, "1 thread / 2 threads", [one / two for one, two in times], "times", least=least)


def measure(state: State) -> float:
    """Wall-clock time of a substep [ns a particle]."""
    start = time.perf_counter()
    state.run(SUBSTEPS, 1e-5, 0.0)
    return (time.perf_counter() - start) / (SUBSTEPS * state.n) * 1e9
