"""Scenes for tests; bodies and free states are those of the verification problems."""

from typing import Any

from fracsim import Backend, Scene
from fracsim.lab.stage import angular_momentum, bar, driven, free, lattice, momentum, ordered, particles

__all__ = ["angular_momentum", "bar", "driven", "free", "lattice", "momentum", "ordered", "particles", "scene"]


def scene(**sections: Any) -> Scene:
    """A scene on one thread."""
    return Scene(**{"backend": Backend(threads=1), **sections})
