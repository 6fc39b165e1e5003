"""How substeps are launched on this machine."""

from typing import NamedTuple

from fracsim import backend
from fracsim.scene.vocab import Backend

CHUNK = 4000
"""A second thread pays from this many particles on, a third from twice as many: starting a parallel loop costs time."""


class Drive(NamedTuple):
    """The launches of a substep."""

    kind: str
    """`serial`, `threads` or `gpu` (see `fracsim.mpm.kernels`)."""
    threads: int = 1
    """Threads, each with a chunk of particles and a copy of the nodes; 1 on a GPU."""

    @classmethod
    def choose(cls, config: Backend, particles: int) -> "Drive":
        """The fastest drive for a number of particles on the running backend."""
        if not backend.on_cpu():
            return cls("gpu")
        threads = min(backend.threads(config), 1 + particles // CHUNK)
        return cls("serial" if threads == 1 else "threads", threads)
