"""Time from a command to its first picture: import, a run with empty caches, the same run again."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fracsim.bench.plan import Plan
from fracsim.bench.record import Row, median
from fracsim.sample.schema import JOURNAL

IMPORT, FIRST, DEMO = 0.5, 8.0, 90.0
"""Targets of the import, the first frame of a warm run, and `make demo` [s]."""
SHORT, SECOND_LAW = ("capture.frames=2",), "material.law=neo_hookean"
LOADED = "import sys, time; t = time.perf_counter(); import fracsim; print(time.perf_counter() - t, *sys.modules)"


@dataclass(frozen=True)
class Timing:
    """Seconds from the start of a process to each frame, and to its end."""

    frames: tuple[float, ...]
    end: float


def rows(plan: Plan) -> Iterator[Row]:
    """Measure with empty caches of Taichi and of objects; the system's file cache is warm."""
    yield from imports(plan.rounds)
    with tempfile.TemporaryDirectory() as folder:
        caches = Path(folder)
        cold = run(caches, "cold", *plan.run)
        compiled = kernels(caches)
        warm = [run(caches, f"warm{k}", *plan.run, *SHORT) for k in range(3)]
        whole = run(caches, "whole", *plan.run)
        before = kernels(caches)
        run(caches, "second", *plan.run, *SHORT, SECOND_LAW)
        more = kernels(caches) - before
    yield Row("cold start", "first frame (object prepared, kernels compiled)", cold.frames[0], "s")
    yield Row("cold start", "frame 1, the first that moved", cold.frames[1], "s")
    yield Row("cold start", "whole `make demo`, once installed", cold.end, "s", most=DEMO)
    yield median("warm start", "first frame", [w.frames[0] for w in warm], "s", most=FIRST)
    yield median("warm start", "frame 1, the first that moved", [w.frames[1] for w in warm], "s")
    yield Row("warm start", "whole `make demo`", whole.end, "s", most=DEMO)
    yield Row("kernels", "compiled by `make demo` (fixed_corotated)", compiled, "kernels")
    yield Row("kernels", "compiled besides for a second law (neo_hookean)", more, "kernels")


def imports(repeats: int) -> Iterator[Row]:
    """The time of `import fracsim`, and the number of heavy packages that it loads."""
    seconds, heavy = [], 0
    for _ in range(repeats):
        done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
        time_spent, *modules = done.stdout.split()
        seconds.append(float(time_spent))
        heavy = max(heavy, len({"taichi", "torch"} & set(modules)))
    yield median("import fracsim", "time", seconds, "s", most=IMPORT)
    yield Row("import fracsim", "of taichi and torch, loaded", heavy, "modules", most=0)


def run(caches: Path, name: str, *overrides: str) -> Timing:
    """Time `python -m fracsim OVERRIDES` with its caches in a folder; RuntimeError, with its output, on failure."""
    out = caches / name
    places = {"FRACSIM_CACHE": str(caches / "objects"), "TI_OFFLINE_CACHE_FILE_PATH": str(caches / "kernels")}
    command = [sys.executable, "-m", "fracsim", f"output.folder={out}", *overrides]
    frames: list[float] = []
    start = time.perf_counter()
    with (caches / "output").open("w+") as output:
        process = subprocess.Popen(command, env=os.environ | places, stdout=output, stderr=subprocess.STDOUT)
        while process.poll() is None:
            time.sleep(0.01)
            written = sum(file.read_text().count("\n") for file in _journals(out))
            frames += [time.perf_counter() - start] * (written - len(frames))
        end = time.perf_counter() - start
        if process.returncode or len(frames) < 2:
            output.seek(0)
            raise RuntimeError(f"{' '.join(command)} ended with status {process.returncode}:\n{output.read()}")
    return Timing(tuple(frames), end)


def _journals(out: Path) -> list[Path]:
    """The journals of the samples in a folder: one line for each written frame."""
    return [file for file in out.glob(f"*/{JOURNAL}") if file.exists()]


def kernels(caches: Path) -> int:
    """Number of kernels in Taichi's cache."""
    return len(list((caches / "kernels").rglob("*.tic")))
