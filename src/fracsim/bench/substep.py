"""One substep of the bar: this project's, a plain one, and one in blocks and colours. They take turns."""

import argparse
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

from fracsim import backend
from fracsim.bench import bar
from fracsim.bench.plan import Plan
from fracsim.bench.record import Row, median
from fracsim.bench.worker import Worker, serve
from fracsim.scene.vocab import DOMAIN, Backend

UNIT = "ns/particle"
FASTER = 8
"""Target of the plain substep's time over that of this project's."""
LANES = 3.5
"""Target of the time of particles one by one over that of eight side by side."""
PLAIN, BLOCKED, OURS, RUBBER = "plain", "blocked", "fixed_corotated", "neo_hookean"
LIKE = "fixed_corotated, pressure=particle"
"""This project's substep with the pressure of `plain` and `blocked`; the default is a cell's pressure."""
ONE_BY_ONE = ", 1 thread, particles one by one"
ALONE, TWINS = ", 1 thread", ", 1 thread, two processes side by side"
MOST = {OURS: 50, RUBBER: 50, OURS + TWINS: 40, RUBBER + TWINS: 40}
"""Targets [ns/particle]: one clip on two threads, and two clips side by side on two cores, as in a sweep."""


def rows(plan: Plan) -> Iterator[Row]:
    """Measure all contestants, on all cores unless the name says otherwise."""
    contestants = {
        PLAIN: ("plain", 0),
        BLOCKED: ("blocked", 0),
        LIKE: ("ours", 0, "--pressure=particle"),
        OURS: ("ours", 0),
        OURS + ALONE: ("ours", 1),
        OURS + ONE_BY_ONE: ("ours", 1, "--one-by-one"),
        RUBBER: ("ours", 0, f"--law={RUBBER}"),
        RUBBER + ALONE: ("ours", 1, f"--law={RUBBER}"),
        RUBBER + ONE_BY_ONE: ("ours", 1, f"--law={RUBBER}", "--one-by-one"),
    }
    sizes = (f"--cells={plan.cells}", f"--substeps={plan.substeps}")
    with ExitStack() as stack:

        def worker(*arguments: object) -> Worker:
            return stack.enter_context(Worker("substep", *arguments, *sizes))

        workers = {name: worker(*arguments) for name, arguments in contestants.items()}
        twins = {law: [workers[law + ALONE], worker(*contestants[law + ALONE])] for law in (OURS, RUBBER)}
        rounds = [_round(workers, twins) for _ in range(plan.rounds)]
        particles = workers[OURS].ready["particles"]
    yield from summary({name: [r[name] for r in rounds] for name in rounds[0]}, particles)


def _round(workers: dict[str, Worker], twins: dict[str, list[Worker]]) -> dict[str, float]:
    """One timing of each contestant [ns per particle and substep], and of each pair of `twins` running side by side."""
    out = {name: float(w.measure()["ns"]) for name, w in workers.items()}
    for law, pair in twins.items():
        for twin in pair:
            twin.go()
        out[law + TWINS] = max(float(twin.answer()["ns"]) for twin in pair) / len(pair)
    return out


def summary(ns: dict[str, list[float]], particles: int) -> Iterator[Row]:
    """Times `ns` and their ratios; a ratio is taken within a round, for `particles` particles."""
    what = f"substep, {particles:,} particles"
    for name, values in ns.items():
        yield median(what, name, values, UNIT, most=MOST.get(name))
    for ours, least in ((LIKE, FASTER), (OURS, None)):
        gain = [a / b for a, b in zip(ns[PLAIN], ns[ours], strict=True)]
        yield median(what, f"{PLAIN} / {ours}", gain, "times", least=least)
    for law in (OURS, RUBBER):
        gain = [a / b for a, b in zip(ns[law + ONE_BY_ONE], ns[law + ALONE], strict=True)]
        yield median(what, f"{law}, 1 thread: one by one / side by side", gain, "times", least=LANES)
    share = [b / a for a, b in zip(ns[BLOCKED], ns[LIKE], strict=True)]
    yield median(what, f"{LIKE} / {BLOCKED}", share, "times", most=1)


def contestant(
    name: str, cells: int, law: str, pressure: str, threads: int, lanes: bool = True, arch: str = "cpu"
) -> Any:
    """The bar of the module `ours`, `plain` or `blocked`; starts Taichi."""
    backend.start(Backend(arch=arch, threads=threads))
    X = bar.lattice(DOMAIN / cells)
    if name == "ours":
        from fracsim.bench.ours import Ours

        return Ours(X, bar.velocity(X), cells, law, pressure, threads, lanes)
    if name == "plain":
        from fracsim.bench.plain import Plain

        return Plain(X, bar.velocity(X), cells)
    from fracsim.bench.blocked import Blocked

    return Blocked(X, bar.velocity(X), cells)


def main() -> None:
    """The process of a contestant: compile, then time substeps at each `go`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("name", choices=("ours", "plain", "blocked"))
    parser.add_argument("threads", type=int)
    parser.add_argument("--law", default="fixed_corotated")
    parser.add_argument("--pressure", default="auto")
    parser.add_argument("--one-by-one", action="store_true")
    parser.add_argument("--arch", default="cpu")
    parser.add_argument("--cells", type=int, required=True)
    parser.add_argument("--substeps", type=int, required=True)
    options = parser.parse_args()
    body = contestant(options.name, options.cells, options.law, options.pressure, options.threads,
                      not options.one_by_one, options.arch)  # fmt: skip
    import taichi as ti

    def measure() -> dict[str, float]:
        start = time.perf_counter()
        body.run(options.substeps)
        ti.sync()
        return {"ns": (time.perf_counter() - start) * 1e9 / (options.substeps * len(body))}

    body.run(2)
    ti.sync()
    serve(measure, particles=len(body))


if __name__ == "__main__":
    main()
