"""Scenes for tests; bodies and free states are those of the verification problems."""

from typing import Any

from fracsim import Backend, Scene
from fracsim.mpm.state import State
from fracsim.records import Particles
from fracsim.verify.stage import angular_momentum, bar, free, lattice, momentum, particles

__all__ = ["angular_momentum", "bar", "driven", "free", "lattice", "momentum", "particles", "scene"]


def scene(**sections: Any) -> Scene:
    """A scene on one thread."""
    return Scene(**{"backend": Backend(threads=1), **sections})


def driven(scene: Scene, body: Particles, drive: str, chunks: int) -> State:
    """A state that runs its substeps by this drive, whatever the machine would choose."""

    class Driven(State):
        def _allocate(self, particles: Particles) -> None:
            self.drive, self.chunks = drive, chunks
            super()._allocate(particles)

    return Driven(scene, body)
