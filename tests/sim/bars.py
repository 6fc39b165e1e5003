"""Scenes and states for tests; bodies are those of the verification problems."""

from typing import Any

from fracsim import Backend, Scene
from fracsim.lab import stage
from fracsim.lab.stage import angular_momentum, bar, lattice, momentum, ordered, particles
from fracsim.mpm.drive import Drive
from fracsim.mpm.state import State
from fracsim.records import Particles
from fracsim.solve import setup

__all__ = ["angular_momentum", "bar", "driven", "free", "gripped", "lattice", "momentum", "ordered", "particles",
           "scene"]  # fmt: skip


def scene(**sections: Any) -> Scene:
    """A scene on one thread."""
    return Scene(**{"backend": Backend(threads=1), **sections})


def free(scene: Scene, body: Particles) -> State:
    """A body of a scene's medium that nothing holds, at rest."""
    return stage.free(setup.medium(scene), body)


def gripped(scene: Scene, body: Particles) -> State:
    """A body between the grips of a scene, launched as the machine allows."""
    return setup.state(scene, body)


def driven(scene: Scene, body: Particles, kind: str, threads: int) -> State:
    """A body between the grips of a scene, launched in this way, whatever the machine would choose."""
    return State(setup.medium(scene), body, setup.grips(scene), Drive(kind, threads))
