"""A substep on the GPU of this machine, beside its CPU: `python -m fracsim.bench gpu`, one command to send back."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

from fracsim import backend
from fracsim.bench.plan import FULL, QUICK
from fracsim.bench.record import Row, median
from fracsim.bench.substep import OURS, RUBBER, UNIT
from fracsim.bench.worker import Worker

ARCHS = ("cuda", "vulkan", "metal")
MANY = 350
"""Cells along the domain at which the bar has a million particles."""
AIM = {"cuda": 4.0}
"""Target [ns/particle] for a million particles on a consumer card of 2020; 2 on an H100."""


def study(out: Path, quick: bool) -> Iterator[Row]:
    """Time and ratio of each GPU backend that this machine has; raises ValueError where it has none."""
    found = [arch for arch in ARCHS if backend.available(arch)]
    if not found:
        raise ValueError(f"none of {', '.join(ARCHS)} is available on this machine: run this where there is a GPU.")
    plan = QUICK if quick else FULL
    yield from rows(found, (plan.cells,) if quick else (plan.cells, MANY), plan.substeps, plan.rounds)


def rows(archs: Sequence[str], sizes: Sequence[int], substeps: int, rounds: int) -> Iterator[Row]:
    """Both laws on these backends and on the CPU, taking turns, for bars with so many cells along the domain."""
    for cells in sizes:
        for law in (OURS, RUBBER):
            with ExitStack() as stack:
                workers = {
                    arch: stack.enter_context(
                        Worker("substep", "ours", 0, f"--law={law}", f"--arch={arch}", f"--cells={cells}",
                               f"--substeps={substeps}")
                    )
                    for arch in ("cpu", *archs)
                }  # fmt: skip
                particles = workers["cpu"].ready["particles"]
                ns = [{arch: float(w.measure()["ns"]) for arch, w in workers.items()} for _ in range(rounds)]
            what = f"substep, {particles:,} particles"
            yield median(what, f"{law}, cpu", [r["cpu"] for r in ns], UNIT)
            for arch in archs:
                most = AIM.get(arch) if cells == MANY else None
                yield median(what, f"{law}, {arch}", [r[arch] for r in ns], UNIT, most=most)
                yield median(what, f"{law}, cpu / {arch}", [r["cpu"] / r[arch] for r in ns], "times")
