"""The only place that starts Taichi."""

import io
import os
from contextlib import redirect_stdout
from functools import cache
from typing import Any

from fracsim.scene.vocab import Backend

_started: Backend | None = None


def start(backend: Backend) -> None:
    """Start Taichi once a process; a second call for the same arch does nothing.

    Raises RuntimeError if this machine lacks the backend, or if Taichi already runs on another arch.
    """
    global _started
    if _started is not None:
        if _started.arch != backend.arch:
            raise RuntimeError(
                f"backend.arch={backend.arch} cannot replace {_started.arch} in a running process: start a new one."
            )
        return
    _require(backend.arch)
    import taichi as ti

    with redirect_stdout(io.StringIO()):  # Taichi has no option that suppresses its greeting
        ti.init(
            arch=getattr(ti, backend.arch),
            default_fp=ti.f32,
            offline_cache=True,
            cpu_max_num_threads=threads(backend),
            log_level=ti.ERROR,
        )
    _started = backend


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


@cache
def _require(arch: str) -> None:
    """Raise RuntimeError if Taichi cannot run on `arch` here: Taichi itself would silently fall back to the CPU."""
    import taichi as ti

    ti.set_logging_level(ti.ERROR)
    probes: dict[str, Any] = {"cuda": ti._lib.core.with_cuda, "vulkan": ti._lib.core.with_vulkan,
                              "metal": ti._lib.core.with_metal}  # fmt: skip
    if arch in probes and not probes[arch]():
        raise RuntimeError(f"backend.arch={arch} is not available on this machine: use backend.arch=cpu.")
