"""The only place that starts Taichi."""

import atexit
import io
import os
import time
import warnings
from contextlib import redirect_stdout, suppress
from functools import cache
from pathlib import Path
from typing import Any

from fracsim import caching, kernel_source
from fracsim.scene.vocab import Backend

kernel_source.quicken()  # before other modules define functions for kernels

MOST_THREADS = 1024
"""Threads that kernels are compiled for: Taichi keeps kernels by this number, and runs them by those of its pool."""
STALE = 60.0
"""Age [s] from which a lock is of a killed process: the list of kernels is read and written in far less."""
_started: Backend | None = None
_forked = False


def start(backend: Backend, alone: bool = True) -> None:
    """Start Taichi once a process; a second call for the same arch does nothing.

    `alone`: whether the cores are for this process. Then each thread gets one of its own, if they are as many.

    Raises RuntimeError if this machine lacks the backend, if Taichi already runs on another arch, or if it ran in a
    process that forked this one.
    """
    global _started
    check_process()
    if _started is not None:
        if _started.arch != backend.arch:
            raise RuntimeError(
                f"backend.arch={backend.arch} cannot replace {_started.arch} in a running process: start a new one."
            )
        return
    _require(backend.arch)
    import taichi as ti

    folder = kernels()
    _unlock(folder)
    before = _own_threads()
    with redirect_stdout(io.StringIO()):  # Taichi has no option that suppresses its greeting
        ti.init(
            arch=getattr(ti, backend.arch),
            default_fp=ti.f32,
            offline_cache=True,
            offline_cache_file_path=str(folder),
            cpu_max_num_threads=threads(backend),
            log_level=ti.ERROR,
        )
    if backend.arch == "cpu":  # the pool has its size by now: only the key of the kernels changes
        ti.lang.impl.get_runtime().prog.config().cpu_max_num_threads = MOST_THREADS
        if alone:
            _spread(_own_threads() - before, threads(backend))
    _started = backend
    atexit.register(stop)  # not left to the destructor of Taichi's program, which may never be called


def stop() -> None:
    """Stop Taichi at the end of a process: it writes the kernels that it has compiled, and its arrays are gone."""
    global _started
    if _started is not None and not _forked:
        import taichi as ti

        ti.reset()
        _started = None


def _own_threads() -> set[int]:
    """The threads of this process, where the system lists them."""
    folder = Path("/proc/self/task")
    return {int(task.name) for task in folder.iterdir()} if folder.is_dir() else set()


def _spread(pool: set[int], count: int) -> None:
    """Give each of the threads of a pool a core of its own, if they are `count` and as many as there are cores.

    All of them work on each substep, which lasts as long as the slowest: where a system puts two on one core, as Linux
    at times does, a substep takes twice as long.
    """
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_setaffinity") else []
    if 1 < count == len(cores) <= len(pool):
        for thread, core in zip(sorted(pool)[-count:], cores, strict=True):
            with suppress(OSError):
                os.sched_setaffinity(thread, {core})


def check_process() -> None:
    """Raise RuntimeError in a process that was forked after Taichi had started: its threads are not here."""
    if _forked:
        raise RuntimeError(
            "this process was forked from one in which fracsim had run, and would wait for ever for its threads: "
            'start it by spawn, as multiprocessing.get_context("spawn").Process(...).'
        )


def _in_child() -> None:
    global _forked
    _forked = _started is not None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)


def first_use() -> bool:
    """Whether no kernels have been kept yet, so that the next run compiles all of its own."""
    return _started is None and not any(kernels().glob("*.tic"))


@cache
def kernels() -> Path:
    """The folder of compiled kernels; warns when it is a temporary one because the other cannot be written to."""
    given = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH")  # Taichi's own name for it
    folder = Path(given) if given else caching.folder() / "kernels"
    if not caching.writable(folder):
        other = caching.temporary() / "kernels"
        warnings.warn(
            f"{folder} cannot be written to: compiled kernels are kept in {other}. Set FRACSIM_CACHE.", stacklevel=2
        )
        return other
    return folder


def _unlock(folder: Path) -> None:
    """Remove the lock of a killed process: with it Taichi would compile everything anew, in silence."""
    for lock in folder.glob("*.lock"):
        with suppress(OSError):
            if time.time() - lock.stat().st_mtime > STALE:
                lock.unlink()


def threads(backend: Backend) -> int:
    """Number of CPU threads in use: `backend.threads`, 0 for all, at most the cores that this process may use."""
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
    return min(backend.threads, available) if backend.threads else available


def has_doubles(backend: Backend) -> bool:
    """Whether a backend computes in float64. Vulkan has the type but not its functions, Metal has neither."""
    return backend.arch in ("cpu", "cuda")


def computes_doubles() -> bool:
    """Whether the running backend computes in float64."""
    return has_doubles(_started or Backend())


def on_cpu() -> bool:
    """Whether the running backend is a CPU."""
    return _started is None or _started.arch == "cpu"


def _require(arch: str) -> None:
    """Raise RuntimeError if Taichi cannot run on `arch` here: Taichi itself would silently fall back to the CPU."""
    if not available(arch):
        raise RuntimeError(f"backend.arch={arch} is not available on this machine: use backend.arch=cpu.")


@cache
def available(arch: str) -> bool:
    """Whether Taichi can run on `arch` here."""
    import taichi as ti

    ti.set_logging_level(ti.ERROR)
    probes: dict[str, Any] = {"cuda": ti._lib.core.with_cuda, "vulkan": ti._lib.core.with_vulkan,
                              "metal": ti._lib.core.with_metal}  # fmt: skip
    return arch not in probes or bool(probes[arch]())
