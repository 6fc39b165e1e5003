"""One substep of the bar: this project's, a plain one, and one in blocks and colours, taking turns."""

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
from fracsim.vocab import DOMAIN, Backend

UNIT = "ns/particle"
FASTER = 8
"""How many times the plain substep ours has to beat."""
TWINS = ("first twin", "second twin")
"""Two processes of one thread that work at the same time."""


def rows(plan: Plan) -> Iterator[Row]:
    """Measure all competitors, each with all cores unless it says otherwise."""
    cores = backend.threads(Backend())
    contestants = {
        "plain": ("plain", cores),
        "blocked": ("blocked", cores),
        "fixed_corotated": ("ours", cores),
        "fixed_corotated, 1 thread": ("ours", 1),
        "neo_hookean": ("ours", cores, "--law=neo_hookean"),
        "neo_hookean, 1 thread": ("ours", 1, "--law=neo_hookean"),
        TWINS[0]: ("ours", 1),
        TWINS[1]: ("ours", 1),
    }
    with ExitStack() as stack:
        sizes = (f"--cells={plan.cells}", f"--substeps={plan.substeps}")
        workers = {name: stack.enter_context(Worker("substep", *words, *sizes)) for name, words in contestants.items()}
        rounds = [_round(workers) for _ in range(plan.rounds)]
    yield from _table({name: [r[name] for r in rounds] for name in rounds[0]}, cores)


def _round(workers: dict[str, Worker]) -> dict[str, float]:
    """One timing of each contestant [ns a particle and substep], the twins together."""
    out = {name: float(w.measure()["ns"]) for name, w in workers.items() if name not in TWINS}
    twins = [workers[name] for name in TWINS]
    for twin in twins:
        twin.go()
    out["twins"] = max(float(twin.answer()["ns"]) for twin in twins) / 2
    return out


def _table(ns: dict[str, list[float]], cores: int) -> Iterator[Row]:
    """Figures and ratios; a ratio is taken within a round."""
    twins = ns.pop("twins")
    for name, values in ns.items():
        threads = "" if "thread" in name else f", {cores} threads"
        ours = "" if name in ("plain", "blocked") else "ours, "
        yield median("substep", f"{ours}{name}{threads}", values, UNIT)
    yield median("substep", "ours, fixed_corotated, two processes of 1 thread side by side", twins, UNIT)
    ours = ns["fixed_corotated"]
    gain = [a / b for a, b in zip(ns["plain"], ours, strict=True)]
    yield median("substep", "plain / ours, fixed_corotated", gain, "times", least=FASTER)
    share = [b / a for a, b in zip(ns["blocked"], ours, strict=True)]
    yield median("substep", "ours / blocked, fixed_corotated", share, "times", most=1)


def contestant(name: str, cells: int, law: str, threads: int) -> Any:
    """The bar in the hands of `ours`, `plain` or `blocked`; starts Taichi."""
    backend.start(Backend(threads=threads))
    X = bar.lattice(DOMAIN / cells)
    if name == "ours":
        from fracsim.bench.ours import Ours

        return Ours(X, bar.velocity(X), cells, law, threads)
    if name == "plain":
        from fracsim.bench.plain import Plain

        return Plain(X, bar.velocity(X), cells)
    from fracsim.bench.blocked import Blocked

    return Blocked(X, bar.velocity(X), cells)


def main() -> None:
    """Be a contestant: compile, then time substeps at each `go`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("name", choices=("ours", "plain", "blocked"))
    parser.add_argument("threads", type=int)
    parser.add_argument("--law", default="fixed_corotated")
    parser.add_argument("--cells", type=int, required=True)
    parser.add_argument("--substeps", type=int, required=True)
    words = parser.parse_args()
    body = contestant(words.name, words.cells, words.law, words.threads)
    import taichi as ti

    def measure() -> dict[str, float]:
        start = time.perf_counter()
        body.run(words.substeps)
        ti.sync()
        return {"ns": (time.perf_counter() - start) * 1e9 / (words.substeps * len(body))}

    body.run(2)
    ti.sync()
    serve(measure)


if __name__ == "__main__":
    main()
