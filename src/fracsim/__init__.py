"""Pull an object until it tears: Gaussian MPM with damage, rendered as RGB and aligned physics maps."""

from fracsim.vocab import (
    Asset,
    Backend,
    Camera,
    Capture,
    Fracture,
    Loading,
    Material,
    Output,
    Scene,
    Solver,
)

__version__ = "0.1.0"
__all__ = [
    "Asset",
    "Backend",
    "Camera",
    "Capture",
    "Fracture",
    "Loading",
    "Material",
    "Output",
    "Scene",
    "Solver",
]
