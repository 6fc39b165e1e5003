"""Pull an object until it tears: Gaussian MPM with damage, rendered as RGB and aligned physics maps."""

import os
from typing import Any

# Taichi greets when it is imported, and asks the network for a newer version when it starts: not for a simulation.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")

from fracsim import caching

if not (os.environ.get("HOME") or os.environ.get("XDG_CACHE_HOME")):  # Taichi would end the process
    os.environ["XDG_CACHE_HOME"] = str(caching.base())

from fracsim.scene.vocab import Asset, Backend, Camera, Capture, Fracture, Loading, Material, Output, Scene, Solver
from fracsim.version import __version__

__all__ = [
    "Asset",
    "Backend",
    "Camera",
    "Capture",
    "Fracture",
    "Loading",
    "Material",
    "Output",
    "Run",
    "Scene",
    "Solver",
    "__version__",
    "compose",
]


def __getattr__(name: str) -> Any:
    """`Run` and `compose` load Taichi and Hydra, so they are imported when first used."""
    if name == "Run":
        from fracsim.run.session import Run

        return Run
    if name == "compose":
        from fracsim.scene.program import compose

        return compose
    raise AttributeError(f"module 'fracsim' has no attribute {name!r}")


def __dir__() -> list[str]:
    """The public names, also those that are imported when first used."""
    return list(__all__)
